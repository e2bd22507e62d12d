"""Every kernel of this room once, so that no robot compiles in flight."""

import numpy as np

from planner.allocation.cbba import AllocationState, build_bundle, hear, word
from planner.allocation.engine import allocate
from planner.allocation.identity import matched
from planner.allocation.score import RobotScore, TeamScores


def warm_allocation() -> None:
    """Two robots share two tasks, on arrays and by words."""
    scores = TeamScores.of(np.ones((2, 2)), np.ones((2, 2)), np.ones((2, 2)), rate=0.1)
    allocate(scores, 1)
    matched(np.ones((1, 1)), 2.0)
    tasks = ["s", "t"]
    states = [AllocationState.start(robot, "ab", 1) for robot in "ab"]
    a, b = (build_bundle(s, tasks, RobotScore(scores, i, tasks)) for i, s in enumerate(states))
    hear(a, word(b, 0.0))
