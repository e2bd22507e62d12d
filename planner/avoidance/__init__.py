"""How robots keep apart, below planning: reciprocal, tolerant of stale positions."""
