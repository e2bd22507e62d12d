"""The ledger: every set that was ever taken, the checkpoints, and how people look at them."""
