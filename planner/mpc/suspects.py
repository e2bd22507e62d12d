"""Where a target may be while its estimate is wider than what the sensor sees at once, or is plainly wrong.

The controller foresees the target at one place. A filter that learns nothing from looking in vain, as (5),
keeps that place where it was, and the paper notes that a robot whose first estimate is far off hardly finds
the target (section IV). So the looks since the last news of the target are kept: places all over the
estimate's Gaussian count by how likely it is that the target there was overlooked by all of them. An
estimate that was looked at in vain is taken to be wrong, and its Gaussian widened.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel

PLACES = 200
SIGMAS = 2.5  # as far out
LOOKS = 120  # kept
FORGET_S = 60.0  # after this long a look says little of a target that moves
EXHAUSTED = 0.2  # of the likeliest place: all was looked at in vain, and it begins anew
GIVEN_UP = 0.6  # of the best place's value, below which another is gone to
WRONG = 0.3  # probability of having been overlooked at the estimate, below which that is wrong
STRAY_M_S = 0.3  # and how fast it gets more wrong
TINY = 1e-9  # m^2, so that a flat covariance has a root


def _spread() -> FloatArray:
    """(2, PLACES) standard normal quantiles along a golden spiral."""
    rank = (np.arange(PLACES) + 0.5) / PLACES
    radius = np.sqrt(-2.0 * np.log(1.0 - rank * (1.0 - math.exp(-0.5 * SIGMAS**2))))
    angle = np.arange(PLACES) * math.pi * (3.0 - math.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


_SPREAD = _spread()


@dataclass(slots=True)
class Suspects:
    """Of one estimate, since there was news of it."""

    looks: deque[tuple[float, FloatArray]] = field(default_factory=lambda: deque(maxlen=LOOKS))  # time, pose
    chosen: int = -1
    doubted_at: float = math.inf  # since when the estimate is taken to be wrong

    def missed(
        self, sensor: SensorModel, places: FloatArray, velocity: FloatArray, time: float, altitude: float
    ) -> FloatArray:
        """Probability (n,) that a target at places (2, n) at `time`, moving with (2,) m/s, was missed."""
        out = np.ones(places.shape[1])
        if not self.looks:
            return out
        points = places if sensor.dimension == 2 else np.vstack([places, np.full(out.size, altitude)])
        ages = np.array([time - looked for looked, _ in self.looks])
        poses = np.stack([pose for _, pose in self.looks])
        poses[:, :2] += ages[:, None] * velocity  # as if the target had stood and the robot moved with it
        seen = np.clip(sensor.detection(np.ascontiguousarray(points), poses), 0.0, 1.0)
        return np.asarray(np.prod(1.0 - np.exp(-ages / FORGET_S)[:, None] * seen, axis=0))

    def doubted(
        self,
        sensor: SensorModel,
        mean: FloatArray,
        covariance: FloatArray,
        velocity: FloatArray,
        time: float,
        altitude: float,
        width: float,
    ) -> FloatArray:
        """The covariance (2, 2), widened if the target should have been seen by now, wherever in it.

        That the mean (2,) alone was looked at in vain says little against a wide estimate.
        """
        if self.missed(sensor, places_of(mean, covariance), velocity, time, altitude).mean() >= WRONG:
            return covariance
        self.doubted_at = min(self.doubted_at, time)
        lost = time - self.doubted_at
        return np.asarray(covariance + (width**2 + (STRAY_M_S * lost) ** 2) * np.eye(2))

    def aim(
        self,
        places: FloatArray,
        missed: FloatArray,
        pose: FloatArray,
        *,
        width: float,
        reach: float,
        half: float,
        speed: float,
        turn_rate: float,
        patience: float,
    ) -> FloatArray:
        """The place (2,) to look at: much suspicion there and within `width` metres for the time until it is
        less than `reach` metres and `half` radians off.

        `patience` (s) is added to that time; a place once chosen is kept until little is left of it.
        """
        if missed.max() < EXHAUSTED:
            self.looks.clear()
            missed = (missed > 0.0).astype(np.float64)
        square = ((places[:, :, None] - places[:, None, :]) ** 2).sum(axis=0)
        apart = 2.0 * math.pi * math.sqrt(max(float(np.linalg.det(np.cov(places))), 0.0)) / PLACES  # m^2
        near = missed * (np.exp(-0.5 * square / (width**2 + 4.0 * apart)) @ missed)
        gap = places - pose[:2, None]
        off = np.arctan2(gap[1], gap[0]) - pose[3]
        drive = np.maximum(np.hypot(gap[0], gap[1]) - reach, 0.0) / speed
        turn = np.maximum(np.abs(np.arctan2(np.sin(off), np.cos(off))) - half, 0.0) / turn_rate
        value = near / (drive + turn + patience)
        best = int(np.argmax(value))
        if self.chosen < 0 or value[self.chosen] < GIVEN_UP * value[best]:
            self.chosen = best
        return np.asarray(places[:, self.chosen])


def places_of(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """(2, PLACES) that stand for an estimate with mean (2,) and covariance (2, 2), each for as much of it."""
    return np.asarray(mean[:, None] + np.linalg.cholesky(covariance + TINY * np.eye(2)) @ _SPREAD)


def careful_speed(width: float, reaction: float, braking: float) -> float:
    """m/s from which a robot stops within `width` metres of where it was `reaction` seconds ago.

    So fast a target that comes into view at the border is not driven up to before the robot can answer:
    v t + v^2 / 2 b = width.
    """
    return braking * (math.sqrt(reaction**2 + 2.0 * width / braking) - reaction)
