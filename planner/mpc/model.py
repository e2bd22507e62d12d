"""What the controller foresees: the robot, the differentiable sensing domain, the target's covariance.

Liu & Hedrick (2017), (1), (5), (7) and the objective J, in plain numbers; `nlp` says the same to the solver.
A plan is rolled out here, so that whatever a solver answers, what is driven obeys the robot's motion.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Limits:
    """U and X of (6d)."""

    slowest: float  # m/s
    fastest: float
    braking: float  # m/s^2, negative
    accelerating: float
    turn_rate: float  # rad/s, both ways


@dataclass(frozen=True, slots=True)
class Domain:
    """gamma of (7): the detection probability of a target at a place."""

    gain: float
    alpha_1: float  # 1/m^2
    alpha_2: float
    edge: float  # cosine of half the opening; -inf: all around

    def gamma(self, gap2: float, cosine: float, angular: bool = True) -> float:
        """Of a squared distance in m^2 and the cosine between heading and bearing."""
        near = self.gain / (1.0 + self.alpha_1 * gap2)
        if not angular or self.edge == -math.inf:
            return near
        return near / (1.0 + math.exp(min(-self.alpha_2 * (cosine - self.edge), 700.0)))


@dataclass(frozen=True, slots=True)
class Foreseen:
    """A rolled-out plan of N steps."""

    controls: FloatArray  # (N, 2) turn rate, acceleration
    states: FloatArray  # (N + 1, 4) x, y, yaw, speed
    covariances: FloatArray  # (N, 3) p_xx, p_xy, p_yy
    objective: float


@dataclass(frozen=True, slots=True)
class Task:
    """One planning problem in numbers."""

    state: FloatArray  # (4,) x, y, yaw, speed
    covariance: FloatArray  # (3,) m^2
    targets: FloatArray  # (N, 2) foreseen, without noise, (5a)
    noise: FloatArray  # (3,) R, m^2
    process: FloatArray  # (3,) Q of a step, m^2
    step: float  # s
    certainty: float  # w_1
    distance: float  # w_2


def rolled_out(task: Task, controls: FloatArray, domain: Domain, limits: Limits, angular: bool) -> Foreseen:
    """(1), (5b)-(5e) and J of controls (N, 2), each brought within the limits first."""
    n = len(task.targets)
    states, spreads, used = np.empty((n + 1, 4)), np.empty((n, 3)), np.empty((n, 2))
    x, y, yaw, v = (float(value) for value in task.state)
    a, b, c = (float(value) for value in task.covariance)
    r, q, t = task.noise, task.process, task.step
    states[0] = x, y, yaw, v
    total = 0.0
    for k in range(n):
        turn = min(max(float(controls[k, 0]), -limits.turn_rate), limits.turn_rate)
        push = min(max(float(controls[k, 1]), limits.braking), limits.accelerating)
        faster = min(max(v + push * t, min(limits.slowest, v)), max(limits.fastest, v))
        push = (faster - v) / t
        x, y, yaw, v = x + t * v * math.cos(yaw), y + t * v * math.sin(yaw), yaw + t * turn, faster
        dx, dy = float(task.targets[k, 0]) - x, float(task.targets[k, 1]) - y
        gap2 = dx * dx + dy * dy
        cosine = math.cos(yaw - math.atan2(dy, dx)) if gap2 > 0 else 1.0
        gamma = domain.gamma(gap2, cosine, angular)
        a, b, c = a + q[0], b + q[1], c + q[2]
        a, b, c = corrected(a, b, c, r, gamma)
        total += task.certainty * (a + c) + task.distance * gap2
        states[k + 1], spreads[k], used[k] = (x, y, yaw, v), (a, b, c), (turn, push)
    return Foreseen(used, states, spreads, float(total))


def corrected(a: float, b: float, c: float, r: FloatArray, gamma: float) -> tuple[float, float, float]:
    """(5c), (5e) with C = I: P - gamma P (P + R)^-1 P of P = [[a, b], [b, c]], written out."""
    s, u, w = a + r[0], b + r[1], c + r[2]
    determinant = s * w - u * u
    # P S^-1 P with the inverse [[w, -u], [-u, s]] / determinant
    aa = (a * (a * w - b * u) + b * (b * s - a * u)) / determinant
    ab = (a * (b * w - c * u) + b * (c * s - b * u)) / determinant
    cc = (b * (b * w - c * u) + c * (c * s - b * u)) / determinant
    return a - gamma * aa, b - gamma * ab, c - gamma * cc


def straight(task: Task, limits: Limits) -> FloatArray:
    """Controls (N, 2) that turn to the target and drive up to it: the first guess, and the fallback."""
    x, y, yaw, v = (float(value) for value in task.state)
    t = task.step
    controls = np.zeros((len(task.targets), 2))
    for k, (tx, ty) in enumerate(task.targets):
        x, y = x + t * v * math.cos(yaw), y + t * v * math.sin(yaw)
        off = math.atan2(ty - y, tx - x) - yaw
        off = math.atan2(math.sin(off), math.cos(off))
        turn = min(max(off / t, -limits.turn_rate), limits.turn_rate)
        yaw += turn * t
        gap = math.hypot(tx - x, ty - y)
        aim = min(limits.fastest, 0.5 * gap / t) * max(math.cos(off - turn * t), 0.0)
        push = min(max((max(aim, limits.slowest) - v) / t, limits.braking), limits.accelerating)
        v += push * t
        controls[k] = turn, push
    return controls
