"""The command that estimates sensors from recordings."""
