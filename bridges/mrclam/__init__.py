"""Recordings of the UTIAS multi-robot data sets, as robots, missions and calibrations."""
