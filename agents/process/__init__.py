"""The processes around Robot and Fusion: clock, network, start and end."""
