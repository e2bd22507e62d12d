"""Two that meet head-on, rehearsed: so that no kernel is compiled or loaded when it happens in earnest."""

import numpy as np

from planner.avoidance.guard import Guard
from planner.avoidance.halt import COLUMNS, going_on
from planner.plan import Ground, VehicleModel

TICKS, TICK_S = 40, 0.1
COMING_M_S, FROM_M = 4.0, 16.0  # through all of it: nobody near, somebody to watch, one to make way for


def meet(vehicle: VehicleModel, pose: np.ndarray | None = None, ground: Ground | None = None) -> None:
    """Fly a guard of this vehicle, from a pose (4,) m, rad, past another that comes towards it."""
    start = np.zeros(4) if pose is None else pose
    steps = max(1, round(TICK_S / vehicle.control_period))
    going_on(np.zeros(COLUMNS), TICK_S)  # as of one that has sped up, which takes longer than this flight
    for level in (True, False):
        guard = Guard("a", {"a": vehicle, "b": vehicle}, 1.0, level=level, ground=ground)
        state = vehicle.initial_state(start)
        waypoint = start[:3] + np.array([50.0, 0.0, 0.0])
        for tick in range(TICKS):
            now = tick * TICK_S
            other = start[:3] + np.array([FROM_M - COMING_M_S * now, 0.1, 0.0])
            guard.see("b", now, other.tolist(), [-COMING_M_S, 0.0, 0.0])
            way = guard.decide(now, state, waypoint)
            goal = waypoint if way is None else way
            state = vehicle.advance(vehicle.begin(state, goal), goal, steps)
