"""One step of the two-step model predictive control of Liu & Hedrick (2017), horizon 10."""

import math
from typing import Any

import numpy as np

from planner.mpc.model import Domain, Limits, Task, rolled_out, straight
from planner.mpc.nlp import Program

TASKS = 10
DOMAIN = Domain(1.0, 1 / 25, 10.0, math.cos(math.radians(30)))
LIMITS = Limits(0.0, 3.0, -3.0, 1.0, math.pi / 4)


def tasks() -> list[Task]:
    """Half of them far from the target and half near it."""
    rng = np.random.default_rng(3)
    made = []
    for i in range(TASKS):
        far = i < TASKS // 2
        place = rng.uniform(0, 50, 2) if far else 25 + rng.uniform(-6, 6, 2)
        spread = np.array([100.0, 0.0, 100.0]) if far else np.array([2.0, 0.0, 2.0])
        made.append(
            Task(
                state=np.array([25.0, 25.0, rng.uniform(-3, 3), 1.0]),
                covariance=spread,
                targets=place + rng.uniform(-0.5, 0.5, 2) * np.arange(1, 11)[:, None],
                noise=np.array([1.0, 0.0, 1.0]),
                process=np.array([0.01, 0.0, 0.01]),
                step=1.0,
                certainty=1.0,
                distance=0.1,
                standoff=DOMAIN.middle[0],
            )
        )
    return made


def test_mpc_step(benchmark: Any) -> None:
    """Both steps, from the straight way as the first guess; the mean of ten problems."""
    one, two = Program(10, DOMAIN, LIMITS, False), Program(10, DOMAIN, LIMITS, True)
    problems = tasks()

    def solve() -> float:
        total = 0.0
        for task in problems:
            best = rolled_out(task, straight(task, LIMITS), DOMAIN, LIMITS, True)
            for program in (one, two):
                found, _ = program.solve(task, best, lambda: False)
                best = min(best, found, key=lambda plan: plan.objective)
            total += best.objective
        return total

    assert math.isfinite(benchmark.pedantic(solve, rounds=3, warmup_rounds=1))
    benchmark.extra_info.update(
        value=1e3 * benchmark.stats.stats.median / TASKS, asked=50.0, unit="ms", peers={}
    )
