"""The lawnmower's path: where the k-th turn is, in one robot's share of the area.

The box is cut along its longer horizontal side into one strip of equal width for each robot. A strip is mown
in lines along its own longer side, as many as bring them at most a swath apart, layer by layer in 3D. Turns
are computed one by one: a path may have millions.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensor import SensorModel

OFFSETS = 60  # distances at which a sensor's reach is looked for
FINEST = 1e-4  # of the area's side, the least of these distances


@dataclass(frozen=True, slots=True)
class Strip:
    """One robot's share (d,) and how it is mown: from one of the corners of each layer."""

    low: FloatArray  # metres
    high: FloatArray  # metres
    swath: float  # metres between lines and layers, at most
    flip: tuple[bool, bool, bool] = (False, False, False)  # along the lines, across them, and in height

    @property
    def lines(self) -> int:
        """In a layer."""
        return _parts(float((self.high - self.low)[1 - self._along]), self.swath)

    @property
    def layers(self) -> int:
        """1 in 2D."""
        return 1 if self.low.size == 2 else _parts(float(self.high[2] - self.low[2]), self.swath)

    @property
    def turns(self) -> int:
        """Corners of the whole path: two for each line."""
        return 2 * self.lines * self.layers

    def turn(self, k: int) -> FloatArray:
        """The k-th corner (d,), from 0 up to `turns` - 1."""
        along, lines = self._along, self.lines
        layer, rest = divmod(k, 2 * lines)
        line, end = divmod(rest, 2)
        if layer % 2:
            line = lines - 1 - line  # back over the layer, so that it begins where the last one ended
        # The end of a line changes with each line of the whole path.
        far = bool(end) ^ bool((layer * lines + (rest // 2)) % 2)
        size = self.high - self.low
        inset = 0.5 * min(self.swath, float(size[along]))
        place = self.low.copy()
        place[along] = self.high[along] - inset if far ^ self.flip[0] else self.low[along] + inset
        share = (line + 0.5) / lines
        place[1 - along] += size[1 - along] * (1.0 - share if self.flip[1] else share)
        if place.size == 3:
            level = (layer + 0.5) / self.layers
            place[2] += size[2] * (1.0 - level if self.flip[2] else level)
        return place

    @property
    def _along(self) -> int:
        """The axis of the lines."""
        return int(np.argmax((self.high - self.low)[:2]))


def share(area: Area, index: int, robots: int, swath: float) -> Strip:
    """The strip of robot `index` of so many."""
    low, high = area.low.astype(np.float64), area.high.astype(np.float64)
    axis = int(np.argmax((high - low)[:2]))
    width = (high[axis] - low[axis]) / robots
    mine, end = low.copy(), high.copy()
    mine[axis], end[axis] = low[axis] + index * width, low[axis] + (index + 1) * width
    return Strip(mine, end, swath)


def reach_width(sensor: SensorModel, area: Area, altitude: float) -> float:
    """Metres across in which a passing robot sees with at least half of its best p_D.

    The robot passes through the middle of the area; how far ahead or behind it sees does not matter. At
    least FINEST of the area's longest side, also for a sensor that sees nothing.
    """
    d = area.dimension
    side = float((area.high - area.low).max())
    far = side * np.geomspace(FINEST, 1.0, OFFSETS)
    both = np.concatenate([-far[::-1], [0.0], far])
    ahead, across = np.meshgrid(both, both, indexing="ij")
    middle = 0.5 * (area.low + area.high)
    points = np.repeat(middle[:, None], ahead.size, axis=1)
    points[0] += ahead.ravel()
    points[1] += across.ravel()
    pose = np.zeros(4)
    pose[:2], pose[2] = middle[:2], middle[2] if d == 3 else altitude
    seen = np.nan_to_num(sensor.detection(np.ascontiguousarray(points), pose[None])[0]).reshape(ahead.shape)
    best = seen.max(axis=0)
    good = both[best >= 0.5 * best.max()] if best.max() > 0 else both[:0]
    return max(float(good.max() - good.min()) if good.size else 0.0, FINEST * side)


def _parts(length: float, swath: float) -> int:
    return max(1, math.ceil(length / swath - 1e-9))
