"""How targets move between measurements: standing, random walk, nearly constant velocity.

Bar-Shalom, Li & Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 6.2.
"""

from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from estimator.arrays import FloatArray, NonNegative


class MotionConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How targets move, in a filter's table of a mission."""

    kind: Literal["static", "random_walk", "constant_velocity"] = "static"
    drift: NonNegative = 0.0  # random_walk: standard deviation after a second and axis, m / s^(1/2)
    acceleration: NonNegative = 0.0  # constant_velocity: white-noise acceleration, m / s^(3/2)
    speed: NonNegative = 1.0  # constant_velocity: standard deviation of a new target's velocity per axis, m/s


@dataclass(frozen=True, slots=True)
class Motion:
    """A linear Gaussian motion x' = F x + noise of states (position(, velocity)) in d dimensions."""

    dimension: int  # d
    config: MotionConfig

    @property
    def state_size(self) -> int:
        """n_x: d, or 2 d where targets have a velocity; positions come first."""
        return self.dimension * (2 if self.config.kind == "constant_velocity" else 1)

    @property
    def is_static(self) -> bool:
        """Whether time changes nothing."""
        return self.config.kind == "static" or (self.config.kind == "random_walk" and self.config.drift == 0)

    def transition(self, duration: float) -> tuple[FloatArray, FloatArray]:
        """F (n_x, n_x) and the noise's covariance Q (n_x, n_x) over `duration` seconds.

        Raises:
            ValueError: if duration is negative or not finite.
        """
        if not 0.0 <= duration < np.inf:
            raise ValueError(f"duration: expected a finite number from 0 up, got {duration}")
        eye: FloatArray = np.eye(self.dimension)
        if self.config.kind == "static":
            return eye, np.zeros_like(eye)
        if self.config.kind == "random_walk":
            return eye, self.config.drift**2 * duration * eye
        t, q = duration, self.config.acceleration**2
        d = self.dimension
        f, noise = np.eye(2 * d), np.empty((2 * d, 2 * d))
        f[:d, d:] = t * eye
        noise[:d, :d], noise[d:, d:] = q * t**3 / 3.0 * eye, q * t * eye
        noise[:d, d:] = noise[d:, :d] = q * t**2 / 2.0 * eye
        return f, noise

    def start_covariance(self, location: FloatArray) -> FloatArray:
        """Covariance (..., n_x, n_x) of a new target whose place has covariance `location` (..., d, d)."""
        d = self.dimension
        if self.state_size == d:
            return np.array(location, dtype=np.float64)
        out = np.zeros((*location.shape[:-2], 2 * d, 2 * d))
        out[..., :d, :d] = location
        out[..., d:, d:] = self.config.speed**2 * np.eye(d)
        return out

    def moved(self, states: FloatArray, duration: float, rng: np.random.Generator) -> FloatArray:
        """States (n_x, n) `duration` seconds later, each with its own noise. Draws nothing if static."""
        if self.is_static or duration == 0.0:
            return states
        f, q = self.transition(duration)
        # Q of a random walk is a multiple of 1, that of constant velocity has full rank unless noiseless.
        values, vectors = np.linalg.eigh(q)
        factor = vectors * np.sqrt(np.maximum(values, 0.0))
        return np.ascontiguousarray(f @ states + factor @ rng.standard_normal(states.shape))
