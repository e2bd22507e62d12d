"""The information-rich tree of an aircraft, which can neither stop nor turn on the spot."""

import dataclasses

import numpy as np
import pytest

from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.irrt.irrt import Irrt
from planner.plan import PlannerSetup
from planner.vehicles.fixed_wing import FixedWing
from tests.planner import contract

RADIUS, SPEED, SIDE = 30.0, 15.0, 600.0


@pytest.mark.parametrize("seed", range(4))
def test_an_aircrafts_way_to_what_it_would_know_is_one_that_it_can_fly(seed: int) -> None:
    area = Area(np.zeros(2), np.full(2, SIDE))
    config = RangeBearing.Config(period_s=1.0, range_sigma_m=1.0, bearing_sigma_deg=1.0, reach_m=[80.0, 80.0])
    vehicle = FixedWing(FixedWing.Config(speed_m_s=SPEED, turn_radius_m=RADIUS))
    sensor = RangeBearing.of(config, area)
    setup = PlannerSetup(dict.fromkeys("abc", vehicle), dict.fromkeys("abc", sensor), area)
    rng = np.random.default_rng(seed)
    pose = np.array([*rng.uniform(150.0, 450.0, 2), 60.0, rng.uniform(-3.0, 3.0)])
    problem = dataclasses.replace(contract.ordinary(setup), state=vehicle.initial_state(pose), others=())
    trajectory = Irrt(Irrt.Config(), setup).plan(problem).trajectory
    said = f"seed {seed}"
    assert trajectory is not None, said
    steps = np.diff(trajectory.poses[:, :2], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    assert lengths.sum() > RADIUS, said
    turns = np.abs(np.diff(np.unwrap(trajectory.poses[:, 3])))
    assert (turns <= SPEED * np.diff(trajectory.times) / RADIUS + 1e-9).all(), said
    assert lengths == pytest.approx(SPEED * np.diff(trajectory.times), rel=0.02, abs=0.05), said
    assert (trajectory.poses[:, :2] >= -contract.SLACK).all(), said
    assert (trajectory.poses[:, :2] <= SIDE + contract.SLACK).all(), said
