"""What the team believes: sensor models, filters, clusters, exploration, metrics.

Pure functions on frozen state: no clock, no input or output, no logging; generators are arguments.
Points are arrays of shape (d, n), one contiguous row per coordinate; poses are (x, y, z, yaw) in the
team's ENU frame, metres and radians.
"""
