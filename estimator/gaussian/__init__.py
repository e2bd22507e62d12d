"""Gaussian mixtures: component algebra, Kalman updates, the GM-PHD filter and the Kalman filter."""
