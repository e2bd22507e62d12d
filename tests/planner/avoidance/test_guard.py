import math

import numpy as np
import pytest

from planner.avoidance.guard import Guard, Sighting
from planner.vehicles.fixed_wing import FixedWing
from planner.vehicles.point_mass import PointMass
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle
from tests.planner.avoidance.crowd import ring, run

CASES = {  # vehicle, metres to keep, radius of the ring, seconds
    "quadrotor": (Quadrotor(Quadrotor.Config(speed_m_s=10.0)), 5.0, 60.0, 30.0),
    "point_mass": (PointMass(PointMass.Config()), 2.0, 30.0, 30.0),
    "unicycle": (Unicycle(Unicycle.Config()), 0.6, 8.0, 40.0),
    "fixed_wing": (FixedWing(FixedWing.Config()), 10.0, 300.0, 60.0),
}


@pytest.fixture(params=sorted(CASES))
def case(request):
    return CASES[request.param]


@pytest.mark.parametrize("delay", [0.05, 0.4])
def test_two_head_on_keep_apart_and_both_arrive(case, delay):
    vehicle, separation, radius, seconds = case
    outcome = run(vehicle, *ring(2, radius), separation, seconds, delay=delay)
    assert outcome.least >= separation
    assert len(outcome.arrived) == 2
    assert outcome.diverted > 0


def test_four_that_cross_keep_apart(case):
    vehicle, separation, radius, seconds = case
    assert run(vehicle, *ring(4, radius), separation, seconds).least >= separation


@pytest.mark.parametrize("delay", [0.05, 0.4])
def test_who_vanished_is_kept_clear_of_where_it_was(case, delay):
    vehicle, separation, radius, seconds = case
    if isinstance(vehicle, FixedWing):
        pytest.skip("an aircraft does not stand")
    starts, goals = ring(2, radius)
    starts["r01"] = np.array([0.0, 0.0, 10.0, math.pi])
    outcome = run(vehicle, starts, goals, separation, seconds, delay=delay, dead=("r01",))
    assert outcome.least >= separation


def test_robots_that_hear_nothing_any_more_keep_apart(case):
    vehicle, separation, radius, seconds = case
    outcome = run(vehicle, *ring(2, radius), separation, seconds, silent_after=1.0)
    assert outcome.least >= separation


def test_the_same_run_gives_the_same_bits():
    vehicle, separation, radius, _ = CASES["point_mass"]
    one, two = (run(vehicle, *ring(3, radius), separation, 12.0) for _ in range(2))
    assert one == two


def test_nobody_near_costs_no_decision():
    vehicle = CASES["quadrotor"][0]
    guard = Guard("a", {"a": vehicle, "b": vehicle}, 5.0, level=True)
    guard.see("b", Sighting(0.0, np.array([500.0, 0.0, 0.0]), np.zeros(3)))
    state = vehicle.initial_state(np.zeros(4))
    assert guard.decide(0.0, state, np.array([9.0, 0.0, 0.0])) is None
    assert guard.idle(1.0)
    assert guard.next_wake > 1.0


def test_poses_that_are_no_numbers_are_not_believed():
    vehicle = CASES["quadrotor"][0]
    guard = Guard("a", {"a": vehicle, "b": vehicle}, 5.0, level=True)
    guard.see("b", Sighting(0.0, np.array([np.nan, 0.0, 0.0]), np.zeros(3)))
    guard.see("stranger", Sighting(0.0, np.zeros(3), np.zeros(3)))
    assert guard.decide(0.0, vehicle.initial_state(np.zeros(4)), np.ones(3)) is None
