"""The Kalman filter whose measurements sometimes fail to come, for one target that is known to exist.

Liu & Hedrick, "Model predictive control-based target search and tracking using autonomous mobile robot with
limited sensing domain", American Control Conference, 2017, (5), after Sinopoli et al., "Kalman filtering with
intermittent observations", IEEE Transactions on Automatic Control, 2004. gamma says whether a measurement
came; a planner that foresees measurements may give it any value from 0 to 1, as (7) does.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import FloatArray, IntArray, Positive
from estimator.filter import Area, Clusters
from estimator.gaussian.components import Components
from estimator.gaussian.extraction import sampled
from estimator.gaussian.update import kalman_pairs
from estimator.motion import Motion, MotionConfig
from estimator.sensor import SensorModel, checked_poses, gaussian, validated

__all__ = ["Kalman", "KalmanConfig", "KalmanState", "corrected", "expected_covariance", "predicted"]


def predicted(
    mean: FloatArray,
    covariance: FloatArray,
    a: FloatArray,
    q: FloatArray,
    shift: FloatArray | float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """(5a), (5b): mean (n,) and covariance (n, n) a step later; `shift` is B u."""
    return np.asarray(a @ mean + shift), np.asarray(a @ covariance @ a.T + q)


def corrected(
    mean: FloatArray,
    covariance: FloatArray,
    y: FloatArray,
    c: FloatArray,
    r: FloatArray,
    gamma: float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """(5c)-(5e): after measurement y (s,) = C x + noise of covariance R, of which `gamma` came.

    Raises:
        ValueError: if gamma is not within 0..1, or C P C' + R is not positive definite.
    """
    gain = _gain(covariance, c, r, gamma)
    rest = covariance - gamma * gain @ c @ covariance
    return np.asarray(mean + gamma * gain @ (y - c @ mean)), np.asarray(0.5 * (rest + rest.T))


def expected_covariance(
    covariance: FloatArray, a: FloatArray, q: FloatArray, c: FloatArray, r: FloatArray, gamma: float
) -> FloatArray:
    """A step of the modified Riccati equation: the predicted covariance (n, n) a step later, if a measurement
    comes with probability gamma. Its fixed point bounds the mean of the random covariance (Sinopoli et al.).

    Raises:
        ValueError: as `corrected`.
    """
    rest = covariance - gamma * _gain(covariance, c, r, gamma) @ c @ covariance
    return np.asarray(a @ rest @ a.T + q)


def _gain(covariance: FloatArray, c: FloatArray, r: FloatArray, gamma: float) -> FloatArray:
    if not 0.0 <= gamma <= 1.0:
        raise ValueError(f"gamma: expected a number from 0 to 1, got {gamma}")
    try:
        lower = np.linalg.cholesky(c @ covariance @ c.T + r)
    except np.linalg.LinAlgError as error:
        raise ValueError("covariance: C P C' + R is not positive definite") from error
    return np.asarray(np.linalg.solve(lower.T, np.linalg.solve(lower, c @ covariance)).T)


class KalmanConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The filter's table in a mission."""

    motion: MotionConfig = MotionConfig()
    start_m: Annotated[list[float], Meta(min_length=2, max_length=3)] | None = None  # default: the centre
    start_sigma_m: Positive | None = None  # per axis; default: that of an even spread over the area
    start_velocity_m_s: Annotated[list[float], Meta(min_length=2, max_length=3)] | None = (
        None  # random_walk: B u
    )
    gate_sigmas: Positive = 5.0  # a measurement further off is of something else


@dataclass(frozen=True, slots=True, eq=False)
class KalmanState:
    """What is believed of the target."""

    mean: FloatArray  # (n_x,) position, then velocity where it has one
    covariance: FloatArray  # (n_x, n_x)
    mass: float  # 1, or 0 once it was removed
    area: Area
    shift: FloatArray | float = 0.0  # B u a second (d,) m/s, of targets that walk randomly


class Kalman:
    """estimator.filter.Filter of one target that exists. Stateless but for its Config; draws nothing.

    Of a set, the measurement nearest to the target (Mahalanobis) counts as the target's if it is inside the
    gate; otherwise none came. What was looked at in vain says nothing, as in (5).
    """

    Config = KalmanConfig

    def __init__(self, config: KalmanConfig) -> None:
        self.config = config

    def __repr__(self) -> str:
        return f"Kalman({self.config})"

    def init(self, area: Area, rng: np.random.Generator) -> KalmanState:
        """One target somewhere about the start.

        Raises:
            ValueError: if start_m or start_velocity_m_s does not fit the area or the motion.
        """
        d, config = area.dimension, self.config
        start = np.array(config.start_m) if config.start_m else 0.5 * (area.low + area.high)
        if start.size != d or not np.isfinite(start).all():
            raise ValueError(f"start_m: expected {d} finite numbers, one per axis, got {config.start_m}")
        sigmas = (area.high - area.low) / np.sqrt(12.0)
        if config.start_sigma_m is not None:
            sigmas = np.full(d, config.start_sigma_m)
        motion = Motion(d, config.motion)
        mean = np.zeros(motion.state_size)
        mean[:d] = start
        velocity = np.array(config.start_velocity_m_s or np.zeros(d))
        if config.start_velocity_m_s and motion.is_static:
            raise ValueError("start_velocity_m_s: a target whose motion is static has none")
        if velocity.size != d or not np.isfinite(velocity).all():
            raise ValueError(
                f"start_velocity_m_s: expected {d} finite numbers, got {config.start_velocity_m_s}"
            )
        mean[d:] = velocity[: mean.size - d]
        shift = velocity if mean.size == d else 0.0
        return KalmanState(mean, motion.start_covariance(np.diag(sigmas**2)), 1.0, area, shift)

    def predict(self, state: KalmanState, duration: float, rng: np.random.Generator) -> KalmanState:
        """(5a), (5b) over `duration` seconds.

        Raises:
            ValueError: if duration is negative or not finite.
        """
        motion = Motion(state.area.dimension, self.config.motion)
        f, q = motion.transition(duration)
        if motion.is_static or duration == 0.0:
            return state
        mean, covariance = predicted(state.mean, state.covariance, f, q, duration * state.shift)
        return replace(state, mean=mean, covariance=covariance)

    def update(
        self,
        state: KalmanState,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        rng: np.random.Generator,
    ) -> KalmanState:
        """(5c)-(5e) with the one measurement of the set (m, s) that is the target's, if any is.

        A sensor that says places measures the position, linearly; of others the extended update is taken.

        Raises:
            ValueError: if an argument has a wrong shape or is not finite, or the sensor gives no place and
                its noise is not Gaussian; names it.
        """
        pose = checked_poses(pose)[0]
        measurements = validated(measurements, sensor.measurement_size)
        if len(measurements) == 0 or state.mass == 0.0:
            return state
        d = state.area.dimension
        if sensor.measurement_size < d:
            return self._extended(state, sensor, pose, measurements)
        places = sensor.locate(measurements, pose)
        spreads = sensor.location_covariance(measurements, pose)
        off = places.T - state.mean[:d]
        solved = np.linalg.solve(state.covariance[:d, :d] + spreads, off[:, :, None])[:, :, 0]
        squares = np.einsum("ka,ka->k", off, solved)
        nearest = int(np.argmin(squares))
        if squares[nearest] > self.config.gate_sigmas**2:
            return state
        c = np.eye(d, state.mean.size)
        mean, covariance = corrected(state.mean, state.covariance, places[:, nearest], c, spreads[nearest])
        return replace(state, mean=mean, covariance=covariance)

    def clusters(self, state: KalmanState, rng: np.random.Generator) -> tuple[KalmanState, Clusters]:
        """The target, always with label 0; none once it was removed."""
        d = state.area.dimension
        if state.mass == 0.0:
            return state, Clusters.none(d)
        covariance = state.covariance[:d, :d].copy()
        radius = np.sqrt(np.trace(covariance) / d)
        found = Clusters(
            state.mean[:d, None].copy(),
            covariance[None],
            np.ones(1),
            np.array([radius]),
            np.zeros(1, np.int64),
            _velocity(state, d),
        )
        return state, found

    def remove(self, state: KalmanState, clusters: IntArray) -> KalmanState:
        """Without the target, if it is among the clusters."""
        return replace(state, mass=0.0) if 0 in clusters else state

    def mass(self, state: KalmanState) -> float:
        """1, or 0 once the target was removed."""
        return state.mass

    def thinned(self, state: KalmanState, size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that lie as the Gaussian does."""
        whole = Components(np.array([state.mass]), state.mean[None], state.covariance[None])
        return sampled(whole, None, size, state.area.dimension)

    def _extended(
        self, state: KalmanState, sensor: SensorModel, pose: FloatArray, measurements: FloatArray
    ) -> KalmanState:
        pairs = kalman_pairs(
            state.mean[None],
            state.covariance[None],
            gaussian(sensor),
            pose,
            measurements,
            gate=self.config.gate_sigmas,
        )
        if pairs.measurements.size == 0:
            return state
        best = int(np.argmax(pairs.log_likelihood))
        return replace(state, mean=pairs.means[best], covariance=pairs.covariances[0])


def _velocity(state: KalmanState, d: int) -> FloatArray:
    """(d, 1): the estimated one, or B u."""
    if state.mean.size >= 2 * d:
        return state.mean[d : 2 * d, None].copy()
    return np.broadcast_to(state.shift, d)[:, None].copy()
