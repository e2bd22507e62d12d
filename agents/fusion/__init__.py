"""The Fusion: a pure state machine, and the estimate that it grows."""
