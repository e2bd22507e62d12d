"""What the controller foresees: the robot, the differentiable sensing domain, the target's covariance.

Liu & Hedrick (2017), (1), (5), (7) and the objective J, in plain numbers; `nlp` says the same to the solver.
In (1) a step is driven at its mean speed and heading, not at those of its beginning: with steps of a second a
robot that stands would else be foreseen to stand for the whole first step, which is all that is driven.
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

    @property
    def reach(self) -> float:
        """Metres, of the sector that gamma stands for: where its range factor is one half."""
        return 1.0 / math.sqrt(self.alpha_1)

    @property
    def middle(self) -> tuple[float, float]:
        """How far ahead (m) the place deepest inside the sector is, and how far (m) it is from its border.

        That is the centre of the largest circle in a sector of radius r and half opening h: it touches the
        arc and, below a right angle, both sides: d sin h = r - d; beyond, the robot itself is its border.
        """
        if self.edge == -math.inf:
            return 0.0, self.reach
        narrow = math.sqrt(1.0 - self.edge**2) if self.edge > 0.0 else 1.0
        ahead = self.reach / (1.0 + narrow)
        return ahead, self.reach - ahead

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
    standoff: float = 0.0  # m ahead of the sensor, whence the distance is taken; 0: J of the paper
    fastest: float = math.inf  # m/s for now, below the robot's own limit

    def ceilings(self, limits: Limits) -> FloatArray:
        """(N,) m/s after each step: the limit, or what can be braked to by then."""
        ahead = self.step * np.arange(1, len(self.targets) + 1)
        least = max(min(self.fastest, limits.fastest), limits.slowest)
        return np.asarray(np.maximum(least, float(self.state[3]) + limits.braking * ahead))


def rolled_out(task: Task, controls: FloatArray, domain: Domain, limits: Limits, angular: bool) -> Foreseen:
    """(1), (5b)-(5e) and J of controls (N, 2), each brought within the limits first."""
    n = len(task.targets)
    states, spreads, used = np.empty((n + 1, 4)), np.empty((n, 3)), np.empty((n, 2))
    x, y, yaw, v = (float(value) for value in task.state)
    a, b, c = (float(value) for value in task.covariance)
    r, q, t = task.noise, task.process, task.step
    states[0] = x, y, yaw, v
    total, ceilings = 0.0, task.ceilings(limits)
    for k in range(n):
        turn = min(max(float(controls[k, 0]), -limits.turn_rate), limits.turn_rate)
        push = min(max(float(controls[k, 1]), limits.braking), limits.accelerating)
        faster = min(max(v + push * t, min(limits.slowest, v)), float(ceilings[k]))
        push = (faster - v) / t
        along, middle = 0.5 * t * (v + faster), yaw + 0.5 * t * turn
        x, y, yaw, v = x + along * math.cos(middle), y + along * math.sin(middle), yaw + t * turn, faster
        dx, dy = float(task.targets[k, 0]) - x, float(task.targets[k, 1]) - y
        gap2 = dx * dx + dy * dy
        cosine = math.cos(yaw - math.atan2(dy, dx)) if gap2 > 0 else 1.0
        gamma = domain.gamma(gap2, cosine, angular)
        a, b, c = a + q[0], b + q[1], c + q[2]
        a, b, c = corrected(a, b, c, r, gamma)
        off = gap2 - 2.0 * task.standoff * cosine * math.sqrt(gap2) + task.standoff**2
        total += task.certainty * (a + c) + task.distance * off
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
    """Controls (N, 2) that turn to the target and drive up to the standoff: first guess, and fallback."""
    x, y, yaw, v = (float(value) for value in task.state)
    t = task.step
    controls, ceilings = np.zeros((len(task.targets), 2)), task.ceilings(limits)
    for k, (tx, ty) in enumerate(task.targets):
        off = math.atan2(ty - y, tx - x) - yaw
        off = math.atan2(math.sin(off), math.cos(off))
        turn = min(max(off / t, -limits.turn_rate), limits.turn_rate)
        gap, towards = math.hypot(tx - x, ty - y), max(math.cos(off - turn * t), 0.0)
        aim = towards * min(float(ceilings[k]), max(0.5 * (gap - task.standoff) / t, 0.0))
        push = min(max((max(aim, limits.slowest) - v) / t, limits.braking), limits.accelerating)
        along, middle = t * (v + 0.5 * push * t), yaw + 0.5 * turn * t
        x, y, yaw, v = (
            x + along * math.cos(middle),
            y + along * math.sin(middle),
            yaw + turn * t,
            v + push * t,
        )
        controls[k] = turn, push
    return controls
