"""Sensor models: p_D, g and c of each kind of sensor."""
