"""How vehicles move: one code for prediction and for simulation."""
