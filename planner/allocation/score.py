"""What tasks are worth to robots: time-discounted rewards less fuel, as CBBA's bids are made from.

Source: Choi, Brunet, How (2009), section V (time-discounted reward); the rewards themselves may be those of
the task information heuristic of Ponda et al. (2012), see `information`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from estimator.arrays import FloatArray, IntArray
from planner.allocation.insertion import insertion_gains


class Score(Protocol):
    """What one robot's path is worth."""

    def gains(self, path: Sequence[str], tasks: Sequence[str]) -> tuple[FloatArray, IntArray]:
        """How much more the path is worth with each of the tasks (t,) at its best place, and that place (t,).

        A gain that is not a finite positive number means that the robot does not bid for the task.
        """


@dataclass(frozen=True, slots=True, eq=False)
class TeamScores:
    """What t tasks are worth to n robots; made by `of`."""

    values: FloatArray  # (n, t) rewards at arrival time 0; -inf: this robot cannot
    first: FloatArray  # (n, t) seconds from each robot's start to each task
    legs: FloatArray  # (c, t, t) seconds from task to task, for each of c kinds of robot
    kinds: IntArray  # (n,) which kind each robot is
    durations: FloatArray  # (t,) seconds
    fuel: float  # per second on the way
    limits: FloatArray  # (n,) seconds within which each robot must be done and home
    home: FloatArray  # (n, t) seconds from each task to each robot's home
    legs_to: FloatArray  # (c, t, t) legs, transposed
    first_e: FloatArray  # exp(-rate * ...) of first, legs, legs_to and durations
    legs_e: FloatArray
    legs_to_e: FloatArray
    durations_e: FloatArray

    @staticmethod
    def of(
        values: FloatArray,
        first: FloatArray,
        legs: FloatArray,
        *,
        kinds: IntArray | None = None,
        durations: FloatArray | None = None,
        rate: float = 0.0,
        fuel: float = 0.0,
        limits: FloatArray | None = None,
        home: FloatArray | None = None,
    ) -> "TeamScores":
        """Checked scores of n robots and t tasks.

        Args:
            values: (n, t), finite or -inf.
            first: (n, t) seconds >= 0; infinite where there is no way.
            legs: (t, t) or (c, t, t) seconds >= 0, from the end of one task to the start of another.
            kinds: (n,) index into legs; default 0.
            durations: (t,) seconds >= 0; default 0.
            rate: of the discount, 1/s: a reward t seconds later is worth exp(-rate t) of itself.
            fuel: what a second on the way costs, in the unit of the values.
            limits: (n,) seconds; default: none.
            home: (n, t) seconds; default 0.

        Raises:
            ValueError: if a shape does not fit or a number is not allowed; names the argument.
        """
        values = _array("values", values, 2)
        n, t = values.shape
        if np.isnan(values).any() or (values == np.inf).any():
            raise ValueError("values: expected finite numbers or -inf, found NaN or inf")
        legs = _array("legs", legs[None] if np.ndim(legs) == 2 else legs, 3)
        _seconds("legs", legs, (legs.shape[0], t, t))
        first = _array("first", first, 2)
        _seconds("first", first, (n, t))
        kinds = np.zeros(n, dtype=np.int64) if kinds is None else np.asarray(kinds, dtype=np.int64)
        if kinds.shape != (n,) or (n and (kinds.min() < 0 or kinds.max() >= len(legs))):
            raise ValueError(f"kinds: expected {n} numbers from 0 to {len(legs) - 1}, got {kinds}")
        durations = np.zeros(t) if durations is None else _array("durations", durations, 1)
        _seconds("durations", durations, (t,))
        limits = np.full(n, np.inf) if limits is None else _array("limits", limits, 1)
        if limits.shape != (n,) or np.isnan(limits).any():
            raise ValueError(f"limits: expected {n} numbers, got {limits}")
        home = np.zeros((n, t)) if home is None else _array("home", home, 2)
        _seconds("home", home, (n, t))
        for name, number in (("rate", rate), ("fuel", fuel)):
            if not (np.isfinite(number) and number >= 0):
                raise ValueError(f"{name}: expected a finite number >= 0, got {number}")
        first, legs, durations = (_reachable(a) for a in (first, legs, durations))
        values = np.where(first >= _FAR, -np.inf, values)
        exps = [_discounts(rate, a) for a in (first, legs, durations)]
        same = bool(np.array_equal(legs, legs.transpose(0, 2, 1)))
        return TeamScores(
            values=values,
            first=first,
            legs=legs,
            kinds=kinds,
            durations=durations,
            fuel=float(fuel),
            limits=limits,
            home=home,
            legs_to=legs if same else np.ascontiguousarray(legs.transpose(0, 2, 1)),
            first_e=exps[0],
            legs_e=exps[1],
            legs_to_e=exps[1] if same else np.ascontiguousarray(exps[1].transpose(0, 2, 1)),
            durations_e=exps[2],
        )

    @property
    def robots(self) -> int:
        return int(self.values.shape[0])

    @property
    def tasks(self) -> int:
        return int(self.values.shape[1])

    def gains(self, robot: int, path: IntArray) -> tuple[FloatArray, IntArray]:
        """Best gains (t,) and places (t,) of all tasks for a robot whose path (k,) holds k tasks."""
        gains, places = np.empty(self.tasks), np.empty(self.tasks, dtype=np.int64)
        kind = self.kinds[robot]
        insertion_gains(
            path,
            path.size,
            self.values[robot],
            self.first[robot],
            self.legs[kind],
            self.legs_to[kind],
            self.durations,
            self.first_e[robot],
            self.legs_e[kind],
            self.legs_to_e[kind],
            self.durations_e,
            self.fuel,
            self.limits[robot],
            self.home[robot],
            gains,
            places,
        )
        return gains, places


class RobotScore:
    """`Score` of one robot of a team, its tasks by name."""

    def __init__(self, scores: TeamScores, robot: int, names: Sequence[str]) -> None:
        self._scores = scores
        self._robot = robot
        self._index: Mapping[str, int] = {name: i for i, name in enumerate(names)}

    def gains(self, path: Sequence[str], tasks: Sequence[str]) -> tuple[FloatArray, IntArray]:
        """As `Score.gains`."""
        way = np.array([self._index[name] for name in path], dtype=np.int64)
        gains, places = self._scores.gains(self._robot, way)
        wanted = np.array([self._index[name] for name in tasks], dtype=np.int64)
        return gains[wanted], places[wanted]


_FAR = 1e12  # seconds: stands for "there is no way", where infinities would make NaN of differences


def _array(name: str, array: FloatArray, dimensions: int) -> FloatArray:
    made = np.ascontiguousarray(array, dtype=np.float64)
    if made.ndim != dimensions:
        raise ValueError(f"{name}: expected an array of {dimensions} dimensions, got shape {made.shape}")
    return made


def _seconds(name: str, array: FloatArray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    if np.isnan(array).any() or (array < 0).any():
        raise ValueError(f"{name}: expected seconds >= 0, found NaN or negative numbers")


def _reachable(seconds: FloatArray) -> FloatArray:
    return np.minimum(seconds, _FAR)


def _discounts(rate: float, seconds: FloatArray) -> FloatArray:
    """exp(-rate * seconds); nothing is left of what is never reached, also without a discount."""
    made = np.exp(-rate * seconds) if rate > 0 else np.ones(seconds.shape)
    return np.where(seconds >= _FAR, 0.0, made)
