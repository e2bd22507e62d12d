"""Two that meet head-on, for a moment: so that no kernel is compiled or loaded when it happens in earnest."""

import numpy as np

from planner.avoidance.guard import Guard
from planner.plan import VehicleModel


def meet(vehicle: VehicleModel) -> None:
    """Ask a guard of this vehicle once."""
    guard = Guard("a", {"a": vehicle, "b": vehicle}, 1.0, level=True)
    guard.see("b", 0.0, [1.0, 0.0, 0.0], [-0.1, 0.0, 0.0])
    guard.decide(0.0, vehicle.initial_state(np.zeros(4)), np.array([5.0, 0.0, 0.0]))
