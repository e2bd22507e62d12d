"""Where a robot was a little while ago, for a sensor that tells late what it saw."""

from bisect import bisect_right
from collections import deque
from math import pi

import numpy as np

from estimator.arrays import FloatArray

KEPT_S = 10.0
BEYOND_S = 0.5  # after the newest pose, in which it is still believed


class PoseHistory:
    """Poses (4,) with growing team times; between two it went straight and turned the shorter way."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()
        self._poses: deque[FloatArray] = deque()

    def __repr__(self) -> str:
        return f"PoseHistory({len(self._times)} poses)"

    def add(self, time: float, pose: FloatArray) -> None:
        """It was there then; an earlier time than the last is passed over."""
        if self._times and time <= self._times[-1]:
            return
        self._times.append(time)
        self._poses.append(pose.copy())
        while self._times[0] < time - KEPT_S:
            self._times.popleft()
            self._poses.popleft()

    def at(self, time: float) -> FloatArray | None:
        """Where it was; None: nobody remembers, or it is not known yet."""
        if not self._times or not self._times[0] <= time <= self._times[-1] + BEYOND_S:
            return None
        after = bisect_right(self._times, time)
        if after == len(self._times):
            return self._poses[-1].copy()
        begin, end = self._times[after - 1], self._times[after]
        before, then = self._poses[after - 1], self._poses[after]
        share = (time - begin) / (end - begin)
        step = then - before
        step[3] = (step[3] + pi) % (2 * pi) - pi
        pose = before + share * step
        pose[3] = float(np.remainder(pose[3] + pi, 2 * pi)) - pi
        return pose
