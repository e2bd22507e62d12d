"""The PHD filter on particles."""
