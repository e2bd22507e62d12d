"""What a sensor is like, from what it measured where the truth is known: noise, p_D, clutter."""
