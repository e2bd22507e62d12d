"""No collision: robots keep their separation in truth, whatever they know of each other."""

from itertools import combinations

import numpy as np

from agents.invariants.connections import Truth, overlap
from agents.invariants.history import RunHistory
from agents.invariants.report import Report

COLLISION = "no collision"
TOLERANCE_M = 1e-6
MEET_S = 4.0  # from the end of a cut until two that fly at each other have met again, heard, and halted


def no_collision(history: RunHistory, truth: Truth, report: Report) -> None:
    """No two robots are nearer than the separation, once they were that far apart.

    Robots that cannot hear each other may both move, and know nothing of it: near passes of such are counted.
    """
    asked = history.mission.settings.separation_m
    if asked <= 0.0:
        return
    names = sorted({name for places in history.places for name in places.robots})
    told: set[tuple[int, int]] = set()
    apart = np.zeros((len(names), len(names)), dtype=bool)  # pairs that were; some may start nearer
    pairs = np.array(list(combinations(range(len(names)), 2)), dtype=np.int64).reshape(-1, 2)
    for places in history.places:
        points = np.array([places.robots.get(name, (np.nan,) * 3) for name in names])
        gaps = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        report.counts["pairs of robots looked at"] += len(gaps)
        if not len(gaps):
            continue
        near = gaps < asked - TOLERANCE_M
        held = apart[pairs[:, 0], pairs[:, 1]]
        if held.any():
            report.least("separation_m", float(np.nanmin(gaps[held])))
        for i, j in pairs[near & held].tolist():
            if (i, j) in told:
                continue
            told.add((i, j))
            if overlap((places.at - MEET_S, places.at), truth.cut(names[i], names[j])):
                report.counts["near passes of robots that could not hear each other"] += 1
            else:
                gap = float(np.linalg.norm(points[i] - points[j]))
                report.violate(
                    COLLISION, places.at, f"{names[i]} and {names[j]} are {gap:.2f} m apart, not {asked:g}"
                )
        apart[pairs[:, 0], pairs[:, 1]] |= gaps >= asked
