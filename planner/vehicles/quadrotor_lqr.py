"""The discrete LQR of the linear quadrotor; `quadrotor` says where model and weights come from."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from estimator.arrays import FloatArray

GRAVITY = 9.81
POSITION_WEIGHT = 1.0 / 15.0
ANGLE_WEIGHT = 1000.0
VELOCITY_WEIGHT = 1000.0
RATE_WEIGHT = 100.0


@dataclass(frozen=True, slots=True)
class Lqr:
    """The discrete LQR of the four chains, with inputs as the accelerations that they cause."""

    level: FloatArray  # (4,) gain on position, tilt, velocity, tilt rate -> angular acceleration
    climb: FloatArray  # (2,) gain on position, velocity -> vertical acceleration
    turn: FloatArray  # (2,) gain on yaw, yaw rate -> angular acceleration
    lag: float  # s: level flight under a steady acceleration is this far behind its reference
    climb_lag: float  # s, nearly the same
    climb_weight: float  # input weight on the vertical acceleration


@cache
def lqr(period: float) -> Lqr:
    """Solve the Riccati equations of the chains; they share no state, input or weight, so it is exact."""

    def gain(a: FloatArray, b: FloatArray, weights: list[float], weight: float) -> FloatArray:
        r = np.array([[weight]])
        p = riccati(a, b, np.diag(weights), r)
        return np.asarray(np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)[0], dtype=np.float64)

    level = gain(*level_chain(period), [POSITION_WEIGHT, ANGLE_WEIGHT, VELOCITY_WEIGHT, RATE_WEIGHT], 1.0)
    lag = level[1] / (GRAVITY * level[2])
    climb_weight = VELOCITY_WEIGHT * lag**2
    climb = gain(*double_integrator(period), [POSITION_WEIGHT, VELOCITY_WEIGHT], climb_weight)
    turn = gain(*double_integrator(period), [ANGLE_WEIGHT, RATE_WEIGHT], 1.0)
    return Lqr(level, climb, turn, float(lag), float(1.0 / climb[1]), float(climb_weight))


def riccati(a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    """The stabilising solution (n, n) of the discrete algebraic Riccati equation.

    Structure-preserving doubling (Chu, Fan, Lin & Wang 2004): each round squares the closed loop, so that
    some thirty rounds do for any chain here. SciPy has a solver too, of which the tests make use, but its
    import alone takes 15 MB and half a second in every robot process.
    """
    one = np.eye(len(a))
    g, h = b @ np.linalg.solve(r, b.T), q
    for _ in range(60):
        inverse = np.linalg.inv(one + g @ h)
        step = a.T @ h @ inverse @ a
        a, g, h = a @ inverse @ a, g + a @ inverse @ g @ a.T, h + step
        if np.abs(step).max() <= 1e-15 * np.abs(h).max():
            break
    return 0.5 * (h + h.T)


def level_chain(t: float) -> tuple[FloatArray, FloatArray]:
    """A (4, 4) and B (4, 1) of position, tilt, velocity, tilt rate under an angular acceleration."""
    a = np.array(
        [
            [1.0, GRAVITY * t**2 / 2, t, GRAVITY * t**3 / 6],
            [0.0, 1.0, 0.0, t],
            [0.0, GRAVITY * t, 1.0, GRAVITY * t**2 / 2],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
    return a, np.array([[GRAVITY * t**4 / 24], [t**2 / 2], [GRAVITY * t**3 / 6], [t]])


def double_integrator(t: float) -> tuple[FloatArray, FloatArray]:
    """A (2, 2) and B (2, 1) of a position and its speed under an acceleration."""
    return np.array([[1.0, t], [0.0, 1.0]]), np.array([[t**2 / 2], [t]])
