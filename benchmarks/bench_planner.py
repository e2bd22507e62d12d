"""How long one plan takes: the 3D mission of (MA)ASI section 7.1.1, from particles to a trajectory."""

from typing import Any

import numpy as np

from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.kmeans import kmeans
from planner.maasi.candidates import CandidateGrid
from planner.maasi.maasi import Maasi
from planner.maasi.maasi_joint import MaasiJoint
from planner.plan import Commitment, PlannerSetup, PlanProblem
from planner.vehicles.quadrotor import Quadrotor

SIDE = 260.0
STARTS = {"a": [1.0, 1.0, 1.0, 0.0], "b": [250.0, 250.0, 250.0, 0.0]}
GRID = CandidateGrid(low=[10, 10, 10], high=[170, 170, 170], points=[3, 3, 3])


def team() -> PlannerSetup:
    area = Area(np.zeros(3), np.full(3, SIDE))
    config = RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=1.5,
        bearing_sigma_deg=0.175,
        elevation_sigma_deg=0.295,
        gain=0.98,
        reach_m=[25.0, 25.0, 25.0],
    )
    vehicle, sensor = Quadrotor(Quadrotor.Config(speed_m_s=12.0)), RangeBearing.of(config, area)
    return PlannerSetup(dict.fromkeys(STARTS, vehicle), dict.fromkeys(STARTS, sensor), area)


def problem(setup: PlannerSetup, robot: str, clusters: Any, others: tuple[Commitment, ...]) -> PlanProblem:
    return PlanProblem(
        robot=robot,
        state=setup.vehicles[robot].initial_state(np.array(STARTS[robot])),
        start_time=0.0,
        measure_period=1.0,
        clusters=clusters,
        exploration=Exploration.unexplored(setup.area, [27, 27, 27]),
        others=others,
        area=setup.area,
        separation=3.0,
    )


def commitment(setup: PlannerSetup, robot: str) -> Commitment:
    """On its way across the area."""
    vehicle = setup.vehicles[robot]
    state = vehicle.initial_state(np.array(STARTS[robot]))
    way = vehicle.trajectory(state, np.array([90.0, 90.0, 90.0]), 0.0, 1.0)
    return Commitment(robot, 1, way.measure_times, way.measure_poses, way.times, way.poses, 1.0)


def particles() -> tuple[Any, Any]:
    """10,000 about 12 targets."""
    rng = np.random.default_rng(1)
    targets = rng.uniform(0, SIDE, (3, 12))
    return targets[:, np.arange(10_000) % 12] + rng.normal(0, 3.0, (3, 10_000)), np.full(10_000, 12 / 10_000)


def test_maasi_plan_27(benchmark: Any) -> None:
    """K-means of 10,000 particles, then one plan: 27 candidates, 27^3 grid, one other robot's commitment."""
    setup = team()
    planner = Maasi(Maasi.Config(candidates=GRID), setup)
    positions, weights = particles()
    others = (commitment(setup, "b"),)

    def plan() -> Any:
        clusters, _ = kmeans(positions, weights, 10.0)
        return planner.plan(problem(setup, "a", clusters.means, others))

    assert benchmark.pedantic(plan, rounds=50, warmup_rounds=3).trajectory is not None
    benchmark.extra_info.update(asked=20.0, unit="ms", peers={"paper, MATLAB": 35.0})


def test_maasi_joint_plan_27_27(benchmark: Any) -> None:
    """Both robots of the paper at once: 27^2 joint indices."""
    setup = team()
    planner = MaasiJoint(MaasiJoint.Config(candidates=GRID), setup)
    positions, weights = particles()
    clusters, _ = kmeans(positions, weights, 10.0)
    problems = tuple(problem(setup, robot, clusters.means, ()) for robot in STARTS)
    plans = benchmark.pedantic(planner.plan_jointly, args=(problems,), rounds=10, warmup_rounds=1)
    assert all(plan.trajectory is not None for plan in plans)
    benchmark.extra_info.update(asked=100.0, unit="ms", peers={"paper, MATLAB": 46.0})
