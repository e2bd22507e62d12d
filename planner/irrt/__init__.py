"""Ponda et al. (2012): Fisher information, the information-rich random tree, the greedy MDP baseline."""
