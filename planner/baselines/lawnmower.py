"""The lawnmower: every robot covers its own share of the area in parallel lines, whatever is believed.

The baseline of (MA)ASI sections 5.1 and 7.2, for any number of robots.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar, Literal

import msgspec
import numpy as np

from estimator.arrays import FloatArray, Positive
from planner.baselines.choice import Option, Pace, taken
from planner.baselines.mowing import Strip, reach_width, share
from planner.deadline import Deadline
from planner.maasi.maasi import unplannable
from planner.plan import Plan, PlannerSetup, PlanProblem

NEAR = 0.05  # of the swath: a turn that is nearer than this is done
LINE = 0.125  # of the swath: how finely a line is searched for a free place
INWARD = (0.25, 0.5, 0.75)  # of a line: where else it is gone to if its end cannot be
AHEAD = 8  # turns that are tried where the next is blocked, and done ones that are passed over at once


class LawnmowerConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the area is mown."""

    swath_m: Positive | None = None  # between lines and layers; none: where p_D is half of its best
    then: Literal["anew", "hold"] = "anew"  # when all is mown


@dataclass(slots=True)
class _Progress:
    """Of one robot."""

    strip: Strip
    next: int = 0  # the turn that it is on its way to
    sweep: int = 1


class Lawnmower:
    """Planner: from turn to turn, begun at the corner of the share that is nearest at first."""

    Config: ClassVar[type[LawnmowerConfig]] = LawnmowerConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: LawnmowerConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self._order = sorted(setup.vehicles)
        self._progress: dict[str, _Progress] = {}
        self._pace = Pace()

    def __repr__(self) -> str:
        return f"Lawnmower({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The way to the next turn; over those that are blocked to one that is not."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        vehicle = self.setup.vehicles[problem.robot]
        here = vehicle.pose(problem.state)[:3]
        if problem.robot not in self._progress:
            self._progress[problem.robot] = self._begun(problem, here)
        progress = self._progress[problem.robot]
        if progress.next == progress.strip.turns and not self._again(progress, problem, here):
            return Plan(None, f"holds: its share is mown, in {progress.sweep} sweep")
        for _ in range(AHEAD):
            place = self._place(progress.strip, progress.next, here)
            near = float(np.linalg.norm(place - here)) < NEAR * progress.strip.swath
            if not (near or vehicle.reached(problem.state, place)):
                break
            progress.next += 1
            if progress.next == progress.strip.turns and not self._again(progress, problem, here):
                return Plan(None, f"holds: its share is mown, in {progress.sweep} sweep")
        else:
            return Plan(None, "holds: its share is no larger than a step")
        options = self._options(progress, here)
        plan = taken(problem, self.setup, options, deadline, self._pace, "its share is mown")
        if plan.trajectory is not None and "turn" in plan.terms:
            # Where a line is left before its end, the end is done all the same: it cannot be reached.
            progress.next = int(plan.terms["turn"]) + int("short" in plan.terms)
            progress.sweep = int(plan.terms["sweep"])
        return plan

    def _again(self, progress: _Progress, problem: PlanProblem, here: FloatArray) -> bool:
        """Begin the next sweep from the corner that is nearest, if there is to be one."""
        if self.config.then == "hold":
            return False
        flip = self._begun(problem, here).strip.flip
        progress.strip, progress.next = replace(progress.strip, flip=flip), 0
        progress.sweep += 1
        return True

    def _options(self, progress: _Progress, here: FloatArray) -> Iterator[Option]:
        """The next turns, those of the next sweep after the last of this one: what is left may be blocked."""
        strip = progress.strip
        for ahead in range(progress.next, progress.next + AHEAD):
            sweep, k = progress.sweep + ahead // strip.turns, ahead % strip.turns
            if sweep > progress.sweep and self.config.then == "hold":
                return
            again = "" if sweep == 1 else f" of sweep {sweep}, begun anew"
            reason = f"turn {k + 1} of {strip.turns}{again}"
            terms = {"turn": float(k), "sweep": float(sweep)}
            place = self._place(strip, k, here)
            yield Option(place, reason, terms=terms)
            if self.setup.ground is not None:  # free, but perhaps walled in: then further along the line
                other = self._place(strip, k ^ 1, here)
                for share in INWARD:
                    place_before = place + share * (other - place)
                    yield Option(place_before, f"{reason}, before its end", terms={**terms, "short": 1.0})

    def _begun(self, problem: PlanProblem, here: FloatArray) -> _Progress:
        """The robot's share, from the corner of it that is nearest."""
        swath = self.config.swath_m or reach_width(
            self.setup.sensors[problem.robot], problem.area, float(here[2])
        )
        index = self._order.index(problem.robot)
        strip = share(problem.area, index, len(self._order), swath)
        d = problem.area.dimension
        both = (False, True)
        ways = [replace(strip, flip=flip) for flip in product(both, both, both)]
        return _Progress(min(ways, key=lambda s: float(np.linalg.norm(s.turn(0) - here[:d]))))

    def _place(self, strip: Strip, k: int, here: FloatArray) -> FloatArray:
        """The k-th turn; in an obstacle, the place on its line that is free and nearest to it."""
        place, ground = here.copy(), self.setup.ground
        turn = strip.turn(k)
        if ground is not None and not ground.clear(turn[:, None])[0]:
            other = strip.turn(k ^ 1)  # the other end of the line
            pieces = 1 + math.ceil(float(np.linalg.norm(other - turn)) / (LINE * strip.swath))
            line = np.linspace(turn, other, pieces, endpoint=False, axis=1)
            free = np.flatnonzero(ground.clear(np.ascontiguousarray(line)))
            turn = line[:, free[0]] if free.size else turn
        place[: strip.low.size] = turn
        return place
