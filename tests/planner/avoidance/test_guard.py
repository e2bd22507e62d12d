"""What one guard promises."""

import math

import numpy as np
import pytest

from planner.avoidance.barrier import allowed
from planner.avoidance.guard import Guard
from planner.avoidance.halt import going_on, halted, settling, steady
from planner.vehicles.fixed_wing import FixedWing
from planner.vehicles.point_mass import PointMass
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle

VEHICLES = {
    "quadrotor": Quadrotor(Quadrotor.Config()),
    "point_mass": PointMass(PointMass.Config()),
    "unicycle": Unicycle(Unicycle.Config()),
    "fixed_wing": FixedWing(FixedWing.Config()),
}
DRONE = VEHICLES["quadrotor"]


def guard(separation=5.0):
    return Guard("a", {"a": DRONE, "b": DRONE}, separation, level=True)


def under_way(vehicle, seconds=4.0):
    """A state in full motion to the east, and its motion."""
    far = np.array([500.0, 0.0, 0.0])
    state = vehicle.begin(vehicle.initial_state(np.zeros(4)), far)
    state = vehicle.advance(state, far, round(seconds / vehicle.control_period))
    return state, motion(vehicle, state)


def motion(vehicle, state):
    return vehicle.evasion.motion(vehicle.pose(state)[:3], vehicle.velocity(state), vehicle.aim(state))


def place(row, seconds):
    out = np.empty(3)
    halted(row, seconds, out)
    return out


def test_nobody_near_costs_no_decision():
    alone = guard()
    alone.see("b", 0.0, [500.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert alone.decide(0.0, DRONE.initial_state(np.zeros(4)), np.array([9.0, 0.0, 0.0])) is None
    assert not alone.watching
    assert alone.next_wake > 5.0  # at its and the other's full speed it would still be far away


def test_somebody_who_turns_up_is_looked_at_at_once():
    surprised = guard()
    assert surprised.decide(0.0, DRONE.initial_state(np.zeros(4)), np.array([9.0, 0.0, 0.0])) is None
    assert surprised.next_wake == math.inf
    surprised.see("b", 0.1, [6.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert surprised.next_wake < 0.1


def goes_on(some, now):
    state, goal = under_way(DRONE, 1.0)[0], np.array([500.0, 0.0, 0.0])
    return some.decide(now, state, goal) is None


def test_late_news_keep_a_robot_going_and_silence_halts_it():
    """Of b 60 m ahead and going the same way: four seconds old each time, or four seconds ago the last."""
    late, silent = guard(), guard()
    for k in range(10):
        late.see("b", 0.2 * k, [60.0 + 2.0 * k, 0.0, 0.0], [10.0, 0.0, 0.0], delay=4.0)
    silent.see("b", 1.8, [78.0, 0.0, 0.0], [10.0, 0.0, 0.0])
    assert goes_on(late, 5.8)
    assert not goes_on(silent, 5.8)


def test_the_later_the_news_the_more_room_is_kept():
    nearest = []
    for delay in (0.1, 1.0, 2.0, 4.0):
        for gap in range(6, 200, 2):
            some = guard()
            some.see("b", 0.0, [float(gap), 0.0, 0.0], [0.0, 0.0, 0.0], delay=delay)
            if goes_on(some, delay):
                nearest.append(gap)
                break
    assert nearest == sorted(set(nearest))
    assert len(nearest) == 4


def test_who_is_expected_and_not_heard_is_reckoned_with_the_longer_the_wider():
    expected = guard()
    expected.park({"b": [150.0, 0.0, 0.0]})
    expected.expect("b")
    assert goes_on(expected, 1.0)
    assert not goes_on(expected, 14.0)
    expected.see("b", 14.0, [500.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    expected.park({"b": [0.0, 0.0, 0.0]})  # what was heard counts
    expected.expect("b")
    assert goes_on(expected, 14.2)


def test_who_never_joined_is_an_obstacle_at_its_start_and_no_more() -> None:
    for gap, fine in ((12.0, False), (80.0, True)):
        parked = guard()
        parked.park({"b": [gap, 0.0, 0.0]})
        assert goes_on(parked, 1.0) is fine
        assert goes_on(parked, 60.0) is fine  # nobody waits for it


def test_poses_that_are_no_numbers_or_of_strangers_are_not_believed():
    wary = guard()
    wary.see("b", 0.0, [math.nan, 0.0, 0.0], [0.0, 0.0, 0.0])
    wary.see("b", 0.0, [3.0, 0.0, 0.0], [math.inf, 0.0, 0.0])
    wary.see("stranger", 0.0, [1.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert wary.decide(0.0, DRONE.initial_state(np.zeros(4)), np.ones(3)) is None
    assert not wary.watching


def test_a_pose_that_was_overtaken_on_its_way_changes_nothing():
    first, second = guard(), guard()
    for some in (first, second):
        some.see("b", 1.0, [8.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    second.see("b", 0.5, [100.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    state, goal = under_way(DRONE, 1.0)[0], np.array([50.0, 0.0, 0.0])
    one, two = (some.decide(1.1, state, goal) for some in (first, second))
    assert one is not None
    assert (one == two).all()


def test_without_a_separation_nothing_is_done():
    free = guard(0.0)
    free.see("b", 0.0, [1.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert free.decide(0.0, DRONE.initial_state(np.zeros(4)), np.ones(3)) is None
    assert free.next_wake == math.inf


@pytest.mark.parametrize("kind", sorted(VEHICLES))
def test_vehicles_halt_where_others_reckon_that_they_do(kind):
    vehicle = VEHICLES[kind]
    state, row = under_way(vehicle)
    circles = kind == "fixed_wing"
    stop = vehicle.pose(state)[:3] if circles else vehicle.steer(state, vehicle.aim(state))
    moving = vehicle.begin(state, stop)
    margin = vehicle.evasion.margin
    for k in range(20):
        seconds = 0.3 * k
        there = vehicle.pose(vehicle.advance(moving, stop, round(seconds / vehicle.control_period)))[:3]
        assert np.linalg.norm(there - place(row, seconds)) <= margin
    if not circles:
        assert np.linalg.norm(place(row, settling(row)) - place(row, 3.0 * settling(row))) < 0.05


@pytest.mark.parametrize("kind", sorted(VEHICLES))
def test_a_steady_vehicle_goes_on_as_reckoned(kind):
    vehicle = VEHICLES[kind]
    state, row = under_way(vehicle, 6.0)
    far = np.array([500.0, 0.0, 0.0])
    assert steady(row, far, vehicle.config.speed_m_s, 1.5)
    assert not steady(row, np.array([300.0, 300.0, 0.0]), vehicle.config.speed_m_s, 1.5)
    assert not steady(row, vehicle.pose(state)[:3], vehicle.config.speed_m_s, 1.5)
    after = motion(vehicle, vehicle.advance(state, far, round(1.5 / vehicle.control_period)))
    np.testing.assert_allclose(going_on(row, 1.5)[:9], after[:9], atol=0.02 * vehicle.config.speed_m_s)


@pytest.mark.parametrize("seed", range(40))
def test_what_the_barrier_allows_two_at_once_leaves_them_apart(seed):
    """Checked densely, for both taking any allowed motion of a random fan in the same tick."""
    rng = np.random.default_rng(seed)
    vehicle, keep, tick = VEHICLES["point_mass"], 2.0, 0.3
    rows = []
    for sign in (-1.0, 1.0):
        velocity = rng.normal(size=3) * 2.0
        velocity *= min(1.0, 5.0 / np.linalg.norm(velocity))
        position = np.array([sign * rng.uniform(2.0, 6.0), *rng.normal(size=2)])
        rows.append(vehicle.evasion.motion(position, velocity, velocity))
    dense = np.linspace(0.0, 6.0, 400)
    if min(np.linalg.norm(place(rows[0], t) - place(rows[1], t)) for t in dense) < keep:
        pytest.skip("not apart to begin with")
    chosen = []
    for own, other in ((rows[0], rows[1]), (rows[1], rows[0])):
        asked = []
        for _ in range(200):
            turn = rng.normal(size=3)
            change = turn / np.linalg.norm(turn) * 2.0 * tick
            after = own.copy()
            after[:3] += (own[3:6] + 0.5 * change) * tick
            after[3:6] = after[6:9] = own[3:6] + change
            asked.append(after)
        none = np.zeros(1)
        fine, _ = allowed(own, np.array(asked), other[None], none, np.full(1, keep), np.full(1, keep), tick)
        chosen.append([after for after, good in zip(asked, fine, strict=True) if good])
    for mine in chosen[0][:12]:
        for theirs in chosen[1][:12]:
            least = min(np.linalg.norm(place(mine, t) - place(theirs, t)) for t in dense[::4])
            assert least >= keep - 1e-3
