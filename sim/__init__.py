"""Worlds, simulated vehicles, sensors and network, and the virtual-time engine."""
