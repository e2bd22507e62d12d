"""Random faults, who brings them about, and the command that lets them loose."""
