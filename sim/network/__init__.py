"""A simulated network, with all that can go wrong on a real one."""
