"""The edges to other systems: Zenoh, Rerun, recorded data sets, autopilots."""
