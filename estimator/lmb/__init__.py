"""Labelled multi-Bernoulli filter: tracks with a label, an existence probability and a Gaussian mixture."""
