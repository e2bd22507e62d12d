"""Where robots and targets can be, and what hides one from the other: occupancy maps and line of sight."""
