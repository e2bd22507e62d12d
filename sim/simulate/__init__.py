"""Many seeds of a mission in virtual time, and what they come to."""
