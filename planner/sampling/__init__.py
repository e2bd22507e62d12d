"""Whole paths sampled from the intensity of targets not yet observed, after Olofsson et al. (2020)."""
