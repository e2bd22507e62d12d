"""The Robot: a pure state machine, and what it is made of."""
