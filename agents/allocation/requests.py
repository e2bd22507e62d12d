"""What operators have asked for: kept by every robot, passed on with every bid, done when enough have looked.

A request is a fact that only grows: robots are added that have looked, and of two requests of one name the
newer holds. So robots may tell each other in any order and as often as they like, and all come to the same;
the operator's own process need not live on.
"""

from collections.abc import Iterable, Mapping, Sequence

import msgspec
import numpy as np

from agents.wire.messages import Wish
from estimator.arrays import FloatArray
from estimator.sensor import SensorModel
from planner.allocation.tasks import Request

PREFIX = "request-"  # of the names of tasks that operators ask for
MOST = 200  # requests that are remembered
LOOKED = 0.5  # share of the best p_D of a sensor at which a place counts as looked at
_DISTANCES, _ANGLES = 40, 24  # of the points at which the best p_D is looked for


class RequestBook:
    """All requests that one robot has heard of."""

    def __init__(
        self,
        sensors: Mapping[str, SensorModel],
        able: Mapping[str, frozenset[str]],
        reach_m: float,
        dimension: int,
    ) -> None:
        """`able`: the capabilities of each robot. Only those count as having looked who were asked to."""
        self._sensors = sensors
        self._able = able
        self._reach = reach_m
        self._dimension = dimension
        self._wishes: dict[str, Wish] = {}
        self._best: dict[str, float] = {}  # p_D by robot

    def __repr__(self) -> str:
        return f"RequestBook({sorted(self._wishes)})"

    def hear(self, wishes: Iterable[Wish]) -> bool:
        """Take in what an operator or another robot tells; whether anything was new."""
        changed = False
        for wish in wishes:
            known = self._wishes.get(wish.name)
            if len(wish.place) != self._dimension or not wish.name.startswith(PREFIX):
                continue
            if known is None or wish.asked > known.asked:
                made = wish
            elif wish.asked == known.asked:
                looked = sorted({*known.looked, *wish.looked})
                made = msgspec.structs.replace(known, looked=looked)
            else:
                continue
            if made != known:
                self._wishes[wish.name] = made
                changed = True
        while len(self._wishes) > MOST:  # those that are done first, then the oldest
            del self._wishes[min(self._wishes, key=lambda n: (self._open(n), self._wishes[n].asked, n))]
        return changed

    def looked(self, time: float, robot: str, pose: FloatArray) -> list[str]:
        """A robot measured at a team time from a pose (4,); the requests that it has looked at by that."""
        sensor = self._sensors.get(robot)
        done: list[str] = []
        for name, wish in self._wishes.items():
            if sensor is None or time < wish.asked or robot in wish.looked or not self._open(name):
                continue
            if not {"request", *wish.needs} <= self._able.get(robot, frozenset()):
                continue
            place = np.array(wish.place, dtype=np.float64)[:, None]
            seen = float(sensor.detection(place, np.asarray(pose)[None])[0, 0])
            if seen >= LOOKED * self._best_detection(robot, sensor, pose):
                self._wishes[name] = msgspec.structs.replace(wish, looked=sorted([*wish.looked, robot]))
                done.append(name)
        return done

    def done(self, name: str) -> bool:
        """Whether nobody need look any more."""
        return not self._open(name)

    def looked_at(self, robot: str) -> frozenset[str]:
        """Requests that a robot has done its part of."""
        return frozenset(name for name, wish in self._wishes.items() if robot in wish.looked)

    def open(self) -> tuple[Request, ...]:
        """Those that are neither done nor withdrawn, as tasks for as many robots as must still look."""
        return tuple(
            Request(
                name,
                np.array(w.place, dtype=np.float64),
                w.worth,
                w.robots - len(w.looked),
                tuple(w.needs),
            )
            for name, w in sorted(self._wishes.items())
            if self._open(name)
        )

    def wishes(self) -> Sequence[Wish]:
        """All of them, to be passed on."""
        return [self._wishes[name] for name in sorted(self._wishes)]

    def _open(self, name: str) -> bool:
        wish = self._wishes[name]
        return wish.worth > 0.0 and len(wish.looked) < wish.robots

    def _best_detection(self, robot: str, sensor: SensorModel, pose: FloatArray) -> float:
        """The highest p_D anywhere around the robot."""
        if robot not in self._best:
            d = self._dimension
            distances = np.geomspace(1e-3 * self._reach, self._reach, _DISTANCES)
            angles = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
            gaps = np.zeros((d, _DISTANCES * _ANGLES))
            gaps[0] = np.outer(distances, np.cos(angles)).ravel()
            gaps[1] = np.outer(distances, np.sin(angles)).ravel()
            seen = sensor.detection(np.ascontiguousarray(np.asarray(pose)[:d, None] + gaps), pose[None])
            self._best[robot] = max(float(np.nan_to_num(seen).max()), 1e-6)
        return self._best[robot]
