"""Separation of one robot from the others, between its decisions and its vehicle. In both drivers.

It sits below planning and waits for nothing: it hears the others' poses, sees where the vehicle steers, and
turns it aside when the barrier of planner.avoidance asks for it. The plan goes on afterwards.
"""

from collections.abc import Mapping

import numpy as np

from agents.devices import Vehicle
from agents.messages import PoseMessage
from estimator.arrays import FloatArray
from planner.avoidance.guard import Guard, Sighting
from planner.plan import Trajectory, VehicleModel

AMEND_S = 1.0  # while off its way, a robot says this often where it now expects to be when


class Separation:
    """Mutable: knows the legs that the vehicle was given, and whether it is off its way."""

    def __init__(
        self,
        robot: str,
        models: Mapping[str, VehicleModel],
        separation: float,
        *,
        level: bool,
        start: FloatArray,
    ) -> None:
        """`start` (3,) is where the vehicle holds until it is given a way."""
        self._guard = Guard(robot, models, separation, level=level)
        self._waypoint = np.array(start)
        self._legs: list[tuple[float, FloatArray]] = []
        self._amend_at = np.inf

    def __repr__(self) -> str:
        return f"Separation({self._guard!r})"

    @property
    def diverted(self) -> bool:
        """Whether the vehicle is off its planned way now."""
        return self._guard.diverted

    @property
    def next_wake(self) -> float:
        """The team time by which `keep` must be called again."""
        return self._guard.next_wake

    def hear(self, message: PoseMessage) -> None:
        """Another robot's pose."""
        self._guard.see(message.sender, Sighting(message.time, message.pose[:3], message.velocity))

    def gone(self, robot: str) -> None:
        """A robot left the team."""
        self._guard.gone(robot)

    def follow(self, trajectory: Trajectory | None, position: FloatArray) -> None:
        """The vehicle was given a way, or at None told to hold at `position` (3,)."""
        if trajectory is None:
            self._legs, self._waypoint = [], np.array(position)
            return
        legs = list(zip(trajectory.route_times.tolist(), trajectory.route, strict=True))
        self._legs = [leg for leg in self._legs if leg[0] < legs[0][0]] + legs

    def keep(self, now: float, vehicle: Vehicle) -> bool:
        """Turn the vehicle aside if need be; whether its trajectory is to be reckoned anew."""
        while self._legs and now >= self._legs[0][0] - 1e-9:
            self._waypoint = self._legs.pop(0)[1]
        if self._guard.idle(now):
            return False
        before = self._guard.diverted
        aside = self._guard.decide(now, vehicle.state(now).state, self._waypoint)
        if aside is not None or before:
            vehicle.detour(aside, now)
        if aside is None:
            self._amend_at = np.inf
            return before
        if not before:
            self._amend_at = now + AMEND_S
        elif now >= self._amend_at:
            self._amend_at = now + AMEND_S
            return True
        return False
