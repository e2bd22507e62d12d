"""What planners see of targets that were found and go on moving."""

import msgspec
import numpy as np
import pytest

from agents.mission.mission_file import load
from agents.team import Team
from planner.plan import Plan, PlanProblem
from sim.engine.engine import Engine


class Watched:
    """A planner that keeps what it was asked."""

    def __init__(self) -> None:
        self.problems: list[PlanProblem] = []

    def plan(self, problem: PlanProblem) -> Plan:
        self.problems.append(problem)
        return Plan(None, "holds: it only watches")


def asked(remove: bool) -> tuple[Engine, list[PlanProblem]]:
    mission = load("missions/crossing.toml", duration=25.0)
    mission = msgspec.structs.replace(mission, found=msgspec.structs.replace(mission.found, remove=remove))
    engine = Engine(Team.of(mission), 3)
    watched = Watched()
    engine.planning._planner = watched
    engine.run()
    return engine, watched.problems


def test_found_targets_that_move_are_clusters_of_the_intensity_with_their_velocities() -> None:
    engine, problems = asked(remove=False)
    last = problems[-1]
    believed = last.intensity
    assert believed is not None
    assert believed.time is not None
    assert last.start_time - 3.0 < believed.time <= last.start_time
    truth = engine.world.targets(believed.time)
    speeds = (engine.world.targets(believed.time) - engine.world.targets(believed.time - 1.0)).T
    assert engine.scoreboard.targets_found >= 4
    assert last.clusters.shape[1] < engine.scoreboard.targets_found  # not yet found: fewer than all
    near = np.linalg.norm(believed.means[:, :, None] - truth[:, None, :], axis=0)  # (clusters, targets)
    seen = (near.min(axis=0) < 3.0).sum()
    assert seen >= 4, f"{seen} of {truth.shape[1]} targets are in what planners see"
    assert believed.velocities is not None
    for target in np.flatnonzero(near.min(axis=0) < 3.0):
        found = believed.velocities[:, near[:, target].argmin()]
        assert np.linalg.norm(found - speeds[target]) < 0.8


@pytest.mark.parametrize("remove", [True, False])
def test_shapes_of_what_planners_see_agree(remove: bool) -> None:
    _, problems = asked(remove)
    for problem in problems:
        believed = problem.intensity
        if believed is None:
            continue
        count = believed.masses.size
        assert believed.means.shape == (2, count)
        assert believed.covariances.shape == (count, 2, 2)
        assert believed.velocities is not None
        assert believed.velocities.shape == (2, count)
        if remove:
            np.testing.assert_array_equal(believed.means, problem.clusters)
