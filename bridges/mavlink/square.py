"""A small test flight: up, a square, down; for a rover the square alone. Pure, like the pilot that flies it.

It ends on the ground, whatever happens: a corner not reached in time, a refusal and an interruption all lead
to a landing. Only somebody who takes the vehicle over keeps it: then it is theirs, and we send nothing.
"""

from dataclasses import dataclass

import numpy as np

from bridges.mavlink.pilot_report import PilotReport
from bridges.mavlink.wanted import GoTo, Land, Rest, TakeOff, Task
from estimator.arrays import FloatArray

WITHIN = {"copter": 1.0, "rover": 2.5}  # m from a corner that count as reached
STAY = 2.0  # s at a corner, in which it may come nearer
START_PATIENCE = 90.0  # s until it is up
SLOWEST = 0.4  # m/s that a leg is flown with at least, or it has failed
LAND_PATIENCE = 180.0  # s until somebody has to be told that it does not come down
GROUND_PATIENCE = 15.0  # s that a vehicle lost on the ground may take to be heard again, and be disarmed
NAMES = ("north", "north-east", "east", "start")


@dataclass(frozen=True, slots=True)
class Corner:
    """How one corner went."""

    name: str
    nearest: float  # m, of all positions while it was the target
    reached: bool
    seconds: float  # from the corner before


class SquareFlight:
    """`task` says what is wanted; `over` that all is done, well if `trouble` is empty."""

    def __init__(self, size: float) -> None:
        self._size = size
        self.corners: list[Corner] = []
        self.trouble = ""
        self.over = False
        self.stage = "starting"  # "starting", "square", "down"
        self._since: float | None = None
        self._places: list[FloatArray] = []
        self._nearest = np.inf
        self._reached_at: float | None = None

    def __repr__(self) -> str:
        return f"SquareFlight({self.stage!r}, {self.corners}, {self.trouble!r})"

    @property
    def good(self) -> bool:
        """Whether all corners were reached and it has landed."""
        return self.over and not self.trouble and len(self.corners) == len(NAMES)

    def stop(self, now: float, why: str) -> None:
        """Come down now."""
        self.trouble = self.trouble or why
        if self.stage != "down":
            self._enter("down", now)

    def task(self, now: float, report: PilotReport) -> Task:
        """What is wanted at `now`."""
        if self._since is None:
            self._since = now
        if report.phase == "taken over" or report.phase in ("refused", "failed"):
            self._end(report.trouble)
        elif report.phase == "lost":
            self.stop(now, report.trouble)  # should it be heard again, it is told to land
            if now - self._since > (LAND_PATIENCE if report.in_air else GROUND_PATIENCE):
                self._end(report.trouble)
        if self.over:
            return Rest()
        stage = {"starting": self._start, "square": self._square, "down": self._down}[self.stage]
        return stage(now, self._since, report)

    def _start(self, now: float, since: float, report: PilotReport) -> Task:
        if report.phase == "flying" and report.position is not None:
            side = self._size
            steps = ((side, 0.0), (side, side), (0.0, side), (0.0, 0.0))
            self._places = [report.position + np.array([north, east, 0.0]) for north, east in steps]
            self._enter("square", now)
            return self._square(now, now, report)
        if now - since > START_PATIENCE:
            why = report.trouble or f"it is still in mode {report.mode}, {report.phase}"
            self.stop(now, f"it was not started within {START_PATIENCE:g} s: {why}")
            return Land()
        return TakeOff()

    def _square(self, now: float, since: float, report: PilotReport) -> Task:
        place = self._places[len(self.corners)]
        if report.phase != "flying":  # a fallback brings it down, or it was disarmed
            self.stop(now, report.fallback or report.trouble or f"it is {report.phase} by itself")
            return Land()
        if report.position is not None:
            away = float(np.linalg.norm(report.position - place))
            self._nearest = min(self._nearest, away)
            if away <= WITHIN.get(report.body, 1.0) and self._reached_at is None:
                self._reached_at = now
        if self._reached_at is not None and now - self._reached_at >= STAY:
            return self._next(now, self._reached_at - since, report)
        leg = 10.0 + self._size / SLOWEST
        if now - since > leg + STAY:
            name = NAMES[len(self.corners)]
            self.corners.append(Corner(name, self._nearest, False, now - since))
            why = f"corner {name} was not reached within {leg:.0f} s, {self._nearest:.1f} m away at best"
            self.stop(now, f"{why}: {report.trouble}" if report.trouble else why)
            return Land()
        return GoTo(place)

    def _next(self, now: float, seconds: float, report: PilotReport) -> Task:
        self.corners.append(Corner(NAMES[len(self.corners)], self._nearest, True, seconds))
        self._nearest, self._reached_at = np.inf, None
        if len(self.corners) == len(NAMES):
            self._enter("down", now)
            return Land()
        self._since = now
        return GoTo(self._places[len(self.corners)])

    def _down(self, now: float, since: float, report: PilotReport) -> Task:
        if report.phase in ("ready", "introducing") and not report.armed:
            self._end("")
        elif now - since > LAND_PATIENCE:
            self._end(f"it is not down {LAND_PATIENCE:g} s after it was told to land, in mode {report.mode}")
        return Land()

    def _enter(self, stage: str, now: float) -> None:
        self.stage, self._since = stage, now

    def _end(self, why: str) -> None:
        self.over = True
        self.trouble = self.trouble or why
