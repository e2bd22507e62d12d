"""Fusion without a centre: neighbours average what they believe."""
