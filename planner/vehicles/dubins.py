"""Shortest ways of a vehicle that only goes forward and turns with at least a radius (Dubins 1957).

Between two poses a shortest way is one of six words of arcs (L, R) and straight parts (S): LSL, RSR, LSR,
RSL, RLR, LRL. To a point, whatever the heading there, it is one of four: LS, RS, LR, RL (Bui et al. 1994).
Each is constructed from its circles; derived here.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.kernels import exact_kernel

TURN = 2.0 * math.pi
SLIP = 1e-9  # of a full turn: rounding must not make a whole turn out of none
WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
_SENSE = {"L": 1.0, "R": -1.0, "S": 0.0}


@dataclass(frozen=True, slots=True)
class DubinsPath:
    """Three parts, each an arc or straight."""

    word: str
    lengths: tuple[float, float, float]  # metres of each part
    radius: float  # m

    @property
    def length(self) -> float:
        return sum(self.lengths)

    def pose(self, start: FloatArray, along: float) -> FloatArray:
        """(3,) x, y, yaw after so many metres from `start` (3,); beyond the end, the end."""
        x, y, yaw = (float(value) for value in start)
        for letter, length in zip(self.word, self.lengths, strict=True):
            part = min(along, length)
            along -= part
            x, y, yaw = arc(x, y, yaw, _SENSE[letter] / self.radius, part)
        return np.array([x, y, yaw])


def shortest(start: FloatArray, goal: FloatArray, radius: float) -> DubinsPath:
    """The shortest way from pose `start` (3,) to pose `goal` (3,), x, y in metres and yaw in radians.

    Raises:
        ValueError: if a pose is not finite or the radius not a positive number.
    """
    poses = np.array([start, goal], dtype=np.float64)
    if poses.shape != (2, 3) or not np.isfinite(poses).all():
        raise ValueError(f"start, goal: expected finite x, y, yaw, got {start}, {goal}")
    if not (radius > 0 and math.isfinite(radius)):
        raise ValueError(f"radius: expected a positive number of metres, got {radius}")
    ways = [way for word in WORDS if (way := path(word, poses[0], poses[1], radius)) is not None]
    return min(ways, key=lambda way: way.length)


def path(word: str, start: FloatArray, goal: FloatArray, radius: float) -> DubinsPath | None:
    """The way of one word, None if there is none."""
    first, last = _SENSE[word[0]], _SENSE[word[2]]
    c1, c2 = _centre(start, first, radius), _centre(goal, last, radius)
    gap, bearing = float(np.hypot(*(c2 - c1))), math.atan2(c2[1] - c1[1], c2[0] - c1[0])
    if word[1] == "S":
        if first == last:
            heading, straight = (bearing if gap > 1e-12 * radius else float(start[2])), gap
        elif gap < 2.0 * radius:
            return None
        else:
            straight = math.sqrt(gap * gap - 4.0 * radius * radius)
            heading = bearing + first * math.atan2(2.0 * radius, straight)
        turns = _turn(first * (heading - start[2])), _turn(last * (goal[2] - heading))
        return DubinsPath(word, (turns[0] * radius, straight, turns[1] * radius), radius)
    if gap > 4.0 * radius:
        return None
    ways = []
    for side in (1.0, -1.0):  # the middle circle touches both from either side
        to_middle = bearing + side * math.acos(min(gap / (4.0 * radius), 1.0))
        middle = c1 + 2.0 * radius * np.array([math.cos(to_middle), math.sin(to_middle)])
        # On a circle of sense s the heading at the centre's direction φ (from it) is φ + s π / 2.
        first_heading = to_middle + first * math.pi / 2
        second_heading = math.atan2(c2[1] - middle[1], c2[0] - middle[0]) - first * math.pi / 2
        lengths = (
            _turn(first * (first_heading - start[2])) * radius,
            _turn(-first * (second_heading - first_heading)) * radius,
            _turn(last * (goal[2] - second_heading)) * radius,
        )
        ways.append(DubinsPath(word, lengths, radius))
    return min(ways, key=lambda way: way.length)


@exact_kernel
def to_point(x: float, y: float, yaw: float, px: float, py: float, radius: float) -> FloatArray:
    """The shortest way to a point, its heading there being free: (4,) sense and metres of its two parts.

    A sense is 1 for left, -1 for right, 0 for straight.
    """
    best = np.zeros(4)
    least = np.inf
    if math.hypot(px - x, py - y) < 1e-9 * radius:
        return best
    for k in range(2):
        s = 1.0 - 2.0 * k
        cx, cy = x - s * radius * math.sin(yaw), y + s * radius * math.cos(yaw)
        gap, bearing = math.hypot(px - cx, py - cy), math.atan2(py - cy, px - cx)
        if gap >= radius:  # an arc, then straight along the tangent
            straight = math.sqrt(gap * gap - radius * radius)
            heading = bearing + s * math.atan2(radius, straight)
            first = _turn(s * (heading - yaw)) * radius
            if first + straight < least:
                least = first + straight
                best[0], best[1], best[2], best[3] = s, first, 0.0, straight
        if radius <= gap <= 3.0 * radius:  # an arc, then one of the other sense through the point
            spread = math.acos(
                min(max((gap * gap + 3.0 * radius * radius) / (4.0 * radius * gap), -1.0), 1.0)
            )
            for j in range(2):
                to_second = bearing + (1.0 - 2.0 * j) * spread
                ox, oy = cx + 2.0 * radius * math.cos(to_second), cy + 2.0 * radius * math.sin(to_second)
                middle = to_second + s * math.pi / 2
                heading = math.atan2(py - oy, px - ox) - s * math.pi / 2
                first, second = _turn(s * (middle - yaw)) * radius, _turn(-s * (heading - middle)) * radius
                if first + second < least:
                    least = first + second
                    best[0], best[1], best[2], best[3] = s, first, -s, second
    return best


@exact_kernel
def arc(x: float, y: float, yaw: float, curvature: float, length: float) -> tuple[float, float, float]:
    """The pose after so many metres with one curvature (1/m, left is positive), by the chord."""
    half = 0.5 * curvature * length
    chord = length * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(yaw + half), y + chord * math.sin(yaw + half), yaw + 2.0 * half


@exact_kernel
def _turn(angle: float) -> float:
    """An angle within [0, 2π), where what is a whole turn but for rounding is none."""
    turned = angle - TURN * math.floor(angle / TURN)
    return 0.0 if turned > TURN * (1.0 - SLIP) else turned


def _centre(pose: FloatArray, sense: float, radius: float) -> FloatArray:
    return np.array(
        [pose[0] - sense * radius * math.sin(pose[2]), pose[1] + sense * radius * math.cos(pose[2])]
    )
