"""When and from where a robot begins its next plan, and what it does with one that comes too late for that.

A plan is asked for some time, the lead, before it begins, so that nobody stands still for one. It is made for
where the robot will be by then.
"""

from dataclasses import replace

import numpy as np

from agents.devices import VehicleState
from estimator.arrays import FloatArray
from estimator.filter import Area
from planner.ground.routes import followed, lifted
from planner.plan import Ground, Trajectory, VehicleModel
from planner.vehicles.route import advanced, routed

PLANNING = 0.8  # share of the lead that a planner may take; the rest is for the answer's way back
LATE_S = 0.02  # a plan that comes this much after its start cannot be followed from there
STILL_M, STILL_M_S = 0.25, 0.1  # a robot that is as near to a late plan's start, and as slow, stands there
FACTOR, KEPT = 1.5, 0.9  # of a late answer's time, and of the lead after one in time
MOST_S = 60.0
NEAR_M = 1.0  # corners of the rest of a way in the open are passed within this


class Lead:
    """How long before its start a plan is asked for: longer after late ones, until they are in time again.

    Args:
        seconds: of team time, at least.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.late = 0  # plans
        self._least = seconds
        self._asked_at = -np.inf

    def __repr__(self) -> str:
        return f"Lead({self.seconds:g} s, {self.late} late)"

    def asked(self, now: float) -> None:
        """A plan was asked for."""
        self._asked_at = now

    def answered(self, now: float, plan: Trajectory) -> bool:
        """A plan is there; whether it is in time."""
        if now <= plan.start_time + LATE_S:
            self.seconds = max(self._least, KEPT * self.seconds)
            return True
        self.late += 1
        self.seconds = min(max(self.seconds, FACTOR * (now - self._asked_at)), max(MOST_S, self._least))
        return False


def departure(
    vehicle: VehicleModel,
    now: float,
    body: VehicleState,
    trajectory: Trajectory | None,
    lead: float,
    held: FloatArray | None = None,
    following: Trajectory | None = None,
) -> tuple[float, FloatArray]:
    """When (team time) and from which full vehicle state (n,) the next trajectory begins.

    At the end of the last one that the robot is on or has committed to, if the plan can be there by then.
    Otherwise `lead` seconds from now, from where the robot will be: on its way, settling where the way has
    ended, or circling.

    Args:
        vehicle: its model.
        now: team time.
        body: of the vehicle, now.
        trajectory: that the robot is on; None: it holds.
        lead: seconds.
        held: (3,) the waypoint that it steers for where it holds; None: where it is.
        following: that it has committed to and not begun yet, if any.
    """
    last = trajectory if following is None else following
    if last is not None and now + PLANNING * lead <= last.end_time <= now + lead + 1e-9:
        return last.end_time, last.end_state
    period = vehicle.control_period
    steps = max(0, round((now + lead - body.time) / period))
    start, first = body.time + steps * period, steps
    if following is not None:
        first = min(max(round((following.start_time - body.time) / period), 0), steps)
    if trajectory is not None:
        state = advanced(vehicle, body.state, trajectory, body.time, first)
    else:
        state = vehicle.advance(body.state, body.pose[:3] if held is None else held, first)
    if following is not None and steps > first:
        state = vehicle.begin(state, following.route[0])
        state = advanced(vehicle, state, following, body.time + first * period, steps - first)
    return start, state


def resumed(
    vehicle: VehicleModel,
    now: float,
    body: VehicleState,
    old: Trajectory,
    period: float,
    area: Area,
    ground: Ground | None,
) -> Trajectory | None:
    """The rest of a trajectory from where the vehicle was turned aside to.

    None where that would bring it too near to something that it may not enter.

    Args:
        vehicle: its model.
        now: team time.
        body: of the vehicle, now.
        old: the trajectory that it was turned aside on.
        period: seconds between measurements.
        area: whose dimension the ground has.
        ground: where the vehicle may be; None: anywhere.
    """
    rest = old.route[max(0, int(np.searchsorted(old.route_times, now, side="right")) - 1) :]
    if ground is None:
        return routed(vehicle, body.state, rest, body.time, period, near=NEAR_M)
    return followed(lifted(ground, area.dimension), vehicle, body.state, rest, body.time, period)


def postponed(plan: Trajectory, now: float, body: VehicleState) -> Trajectory | None:
    """A late plan, begun now instead, if the robot still stands where it begins; None if it does not."""
    away = float(np.linalg.norm(body.pose[:3] - plan.poses[0, :3]))
    if away > STILL_M or float(np.linalg.norm(body.velocity)) > STILL_M_S:
        return None
    late = now - plan.start_time
    return replace(
        plan,
        start_time=now,
        end_time=plan.end_time + late,
        measure_times=plan.measure_times + late,
        times=plan.times + late,
        route_times=plan.route_times + late,
    )
