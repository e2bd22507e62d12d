"""The launcher of a team on this machine, and what it makes of a run."""
