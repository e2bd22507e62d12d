"""Separation of one robot from the others, between its decisions and its vehicle. In both drivers.

It sits below planning and waits for nothing: it hears the others' poses, sees where the vehicle steers, and
turns it aside when the barrier of planner.avoidance asks for it. The plan goes on afterwards.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from agents.devices import Vehicle
from agents.wire.messages import PoseMessage
from estimator.arrays import FloatArray
from planner.avoidance.guard import Guard
from planner.plan import Ground, Trajectory, VehicleModel

SOON = 0.75  # share of the time to the next decision after which one is made if the robot is awake anyway
AMEND_S = 1.0  # while off its way, a robot says this often where it now expects to be when

_News = tuple[PoseMessage, float]  # and how old it was when it came, s


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
        ground: Ground | None = None,
        starts: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """`start` (3,) is where the vehicle holds until it is given a way; `level`: the team lives in 2D.

        `starts` (3,) are where the others begin.
        """
        self._guard = Guard(robot, models, separation, level=level, ground=ground)
        if starts:
            self._guard.park(starts)
        self._waypoint = np.array(start)
        self._legs: list[tuple[float, FloatArray]] = []
        self._amend_at = np.inf
        self._early = -np.inf
        self._news: dict[str, tuple[_News, ...]] = {}  # the last two of each, looked at when it matters
        self._unseen: set[str] = set()

    def __repr__(self) -> str:
        return f"Separation({self._guard!r})"

    @property
    def diverted(self) -> bool:
        """Whether the vehicle is off its planned way now."""
        return self._guard.diverted

    @property
    def next_wake(self) -> float:
        """The team time by which `keep` must be called again."""
        # With somebody near, a turn at a corner of the way is looked at when it comes.
        corner = self._legs[0][0] if self._legs and self._guard.watching else np.inf
        return min(self._guard.next_wake, corner)

    def hear(self, message: PoseMessage, now: float) -> None:
        """Another robot's pose, which came at team time `now`."""
        sender, news = message.sender, (message, now - message.time)
        before = self._news.get(sender)
        if before is None or message.boot != before[-1][0].boot:
            self._look(news)  # new, or started anew somewhere else
        self._news[sender] = (news,) if before is None else (before[-1], news)
        self._unseen.add(sender)

    def _look(self, news: _News) -> None:
        message, delay = news
        position, velocity = message.pose[:3].tolist(), message.velocity.tolist()
        self._guard.see(message.sender, message.time, position, velocity, delay)

    def expect(self, robot: str) -> None:
        """A robot joined: until it is heard, it may be as far from its start as the time since allows."""
        self._guard.expect(robot)

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
        before_turn = self._waypoint
        while self._legs and now >= self._legs[0][0] - 1e-9:
            self._waypoint = self._legs.pop(0)[1]
        turned = self._waypoint is not before_turn and self._guard.watching
        if not turned and now < min(self._guard.next_wake, self._early) - 1e-9:
            return False
        for sender in sorted(self._unseen):
            for news in self._news[sender]:
                self._look(news)
        self._unseen.clear()
        before = self._guard.diverted
        aside = self._guard.decide(now, vehicle.state(now).state, self._waypoint)
        self._early = now + SOON * (self._guard.next_wake - now)
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
