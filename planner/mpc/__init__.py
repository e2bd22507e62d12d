"""Liu & Hedrick (2017): model predictive control with a differentiable sensing domain."""
