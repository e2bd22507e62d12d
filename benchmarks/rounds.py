"""How many rounds of words robots need until all of them hold the final allocation, with and without loss."""

import numpy as np

from estimator.arrays import BoolArray
from planner.allocation.cbba import AllocationState, build_bundle, hear, word
from planner.allocation.engine import allocate, named
from planner.allocation.score import RobotScore, TeamScores

MOST = 2000


def graph(kind: str, robots: int) -> BoolArray:
    """(n, n) who hears whom: "complete", "ring" or "line"."""
    gap = np.abs(np.arange(robots)[:, None] - np.arange(robots))
    if kind == "complete":
        return gap > 0
    return (gap == 1) | ((gap == robots - 1) if kind == "ring" else False)


def team(robots: int, tasks: int, seed: int) -> TeamScores:
    """Places in a square kilometre, 10 m/s, rewards of 50 to 100 that lose 1% a second."""
    rng = np.random.default_rng(seed)
    starts, places = rng.uniform(0, 1000, (robots, 2)), rng.uniform(0, 1000, (tasks, 2))
    return TeamScores.of(
        rng.uniform(50, 100, (robots, tasks)),
        np.linalg.norm(starts[:, None] - places, axis=2) / 10,
        np.linalg.norm(places[:, None] - places, axis=2) / 10,
        rate=0.01,
    )


def rounds(scores: TeamScores, capacity: int, heard: BoolArray, loss: float, seed: int) -> int:
    """Rounds until all robots hold what they hold in the end. In each all bid, and each word may be lost.

    Raises:
        RuntimeError: if they do not come to it.
    """
    rng = np.random.default_rng([seed, 1])
    robots = [f"r{i:03d}" for i in range(scores.robots)]
    tasks = [f"t{j:03d}" for j in range(scores.tasks)]
    final = named(allocate(scores, capacity).paths, robots, tasks)
    states = [AllocationState.start(robot, robots, capacity) for robot in robots]
    values = [RobotScore(scores, i, tasks) for i in range(len(robots))]
    for turn in range(MOST):
        states = [build_bundle(state, tasks, value) for state, value in zip(states, values, strict=True)]
        agents = [state.winning_agents for state in states]
        if all(view == agents[0] for view in agents) and all(s.path == final[s.robot] for s in states):
            return turn
        words = [word(state, float(turn)) for state in states]
        for i in range(len(states)):
            for k in np.flatnonzero(heard[i]):
                if rng.random() >= loss:
                    states[i], _ = hear(states[i], words[k])
    raise RuntimeError(f"no agreement after {MOST} rounds")
