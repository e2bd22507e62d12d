"""MAVLink vehicles: what flies a real autopilot as a mission flies a simulated quadrotor."""
