"""Whole crowds under guards: nobody ever comes too near to another, and all arrive."""

import math

import numpy as np
import pytest

from estimator.filter import Area
from planner.ground.build import GroundPlan, built
from planner.ground.shapes import Shape
from planner.vehicles.fixed_wing import FixedWing
from planner.vehicles.point_mass import PointMass
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle
from tests.planner.avoidance.crowd import Crowd, ring, run

CASES = {  # vehicle, metres to keep, radius of the ring, seconds
    "quadrotor": (Quadrotor(Quadrotor.Config(speed_m_s=10.0)), 5.0, 60.0, 60.0),
    "point_mass": (PointMass(PointMass.Config()), 2.0, 30.0, 60.0),
    "unicycle": (Unicycle(Unicycle.Config()), 0.6, 8.0, 90.0),
    "fixed_wing": (FixedWing(FixedWing.Config()), 10.0, 300.0, 80.0),
}
KINDS = sorted(CASES)
STANDING = [kind for kind in KINDS if kind != "fixed_wing"]  # an aircraft does not stand
LINKS = {
    "late": {"delay": 0.4},
    "lossy": {"loss": 0.5},
    "disordered": {"delay": 0.2, "jitter": 0.4, "loss": 0.3},
}


def check(crowd, seconds, arrive=None):
    outcome = run(crowd, seconds)
    assert outcome.least >= crowd.separation, f"{outcome.pair} came as near as {outcome.least:.2f} m"
    missing = set(crowd.starts if arrive is None else arrive) - outcome.arrived.keys()
    assert not missing, f"{sorted(missing)} did not arrive within {seconds} s"
    return outcome


def on_a_ring(kind, count, **how):
    vehicle, separation, radius, seconds = CASES[kind]
    starts, goals = ring(count, radius)
    return Crowd(dict.fromkeys(starts, vehicle), starts, goals, separation, **how), seconds


@pytest.mark.parametrize("kind", KINDS)
def test_twenty_change_places_and_all_arrive(kind):
    outcome = check(*on_a_ring(kind, 20))
    assert outcome.diverted > 0


@pytest.mark.parametrize("kind", ["point_mass"])
def test_fifty_change_places_and_all_arrive(kind):
    check(*on_a_ring(kind, 50))


@pytest.mark.parametrize("link", sorted(LINKS))
@pytest.mark.parametrize("kind", KINDS)
def test_poses_that_come_late_or_not_at_all_cost_time_but_never_distance(kind, link):
    crowd, seconds = on_a_ring(kind, 6, **LINKS[link])
    check(crowd, seconds)


def test_different_vehicles_keep_apart_by_each_others_limits():
    kinds = [
        PointMass(PointMass.Config()),
        Unicycle(Unicycle.Config(speed_m_s=2.0)),
        Quadrotor(Quadrotor.Config(speed_m_s=6.0)),
    ]
    starts, goals = ring(12, 30.0)
    models = {robot: kinds[i % 3] for i, robot in enumerate(sorted(starts))}
    check(Crowd(models, starts, goals, 2.0), 90.0)


def test_aircraft_and_drones_share_the_air():
    kinds = [
        FixedWing(FixedWing.Config()),
        Quadrotor(Quadrotor.Config(speed_m_s=10.0)),
        FixedWing(FixedWing.Config(speed_m_s=20.0, turn_radius_m=50.0)),
    ]
    starts, goals = ring(9, 200.0)
    models = {robot: kinds[i % 3] for i, robot in enumerate(sorted(starts))}
    check(Crowd(models, starts, goals, 8.0), 120.0)


@pytest.mark.parametrize("across", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_two_streams_pass_through_each_other(kind, across):
    vehicle, separation, radius, seconds = CASES[kind]
    gap = separation * (4.0 if kind != "fixed_wing" else 15.0)  # aircraft circle where they arrive
    count = 5 if kind != "fixed_wing" else 3
    starts, goals = {}, {}
    for i in range(count):
        first, last = radius + i * gap, radius + (count - 1 - i) * gap
        starts[f"a{i}"], goals[f"a{i}"] = np.array([-first, 0.0, 10.0, 0.0]), np.array([last, 0.0, 10.0])
        if across:
            starts[f"b{i}"] = np.array([0.0, -first, 10.0, math.pi / 2])
            goals[f"b{i}"] = np.array([0.0, last, 10.0])
        else:
            starts[f"b{i}"] = np.array([first, 0.01, 10.0, math.pi])
            goals[f"b{i}"] = np.array([-last, 0.01, 10.0])
    check(Crowd(dict.fromkeys(starts, vehicle), starts, goals, separation), 2.0 * seconds)


@pytest.mark.parametrize("kind", ["point_mass", "quadrotor", "fixed_wing"])
def test_in_three_dimensions_too(kind):
    vehicle, separation, radius, seconds = CASES[kind]
    rng = np.random.default_rng(3)
    starts, goals = {}, {}
    for i in range(8):
        away = rng.normal(size=3) * (1.0, 1.0, 1.0 if kind != "fixed_wing" else 0.05)
        away *= radius / np.linalg.norm(away)
        starts[f"r{i}"], goals[f"r{i}"] = np.append(away, rng.uniform(-3.0, 3.0)), -away
    check(Crowd(dict.fromkeys(starts, vehicle), starts, goals, separation, level=False), 1.5 * seconds)


@pytest.mark.parametrize("kind", ["point_mass", "quadrotor"])
def test_who_meets_above_and_below_passes_too(kind):
    vehicle, separation, radius, seconds = CASES[kind]
    starts = {"a": np.zeros(4), "b": np.array([0.0, 0.0, radius, 0.0])}
    goals = {"a": np.array([0.0, 0.0, radius]), "b": np.zeros(3)}
    check(Crowd(dict.fromkeys(starts, vehicle), starts, goals, separation, level=False), seconds)


@pytest.mark.parametrize("kind", STANDING)
def test_a_robot_that_stands_in_the_way_is_gone_around(kind):
    crowd, seconds = on_a_ring(kind, 6, dead=("r02",))
    crowd.starts["r02"][:2] = 0.0
    check(crowd, seconds, arrive=set(crowd.starts) - {"r02"})


@pytest.mark.parametrize("kind", STANDING)
def test_a_robot_that_falls_silent_and_halts_on_its_way_is_gone_around(kind):
    vehicle, _, radius, _ = CASES[kind]
    crowd, seconds = on_a_ring(kind, 6, struck={"r01": 0.7 * radius / vehicle.config.speed_m_s})
    check(crowd, seconds, arrive=set(crowd.starts) - {"r01"})


@pytest.mark.parametrize("kind", KINDS)
def test_robots_that_hear_nobody_any_more_keep_apart(kind):
    vehicle, _, radius, _ = CASES[kind]
    crowd, _ = on_a_ring(kind, 6, deaf_after=0.6 * radius / vehicle.config.speed_m_s)
    check(crowd, 30.0, arrive=())


@pytest.mark.parametrize("crossing", [True, False])
@pytest.mark.parametrize("half_width", [1.5, 1.1])
def test_in_corridors_nobody_is_pushed_into_a_wall(half_width, crossing):
    vehicle, separation, radius = CASES["unicycle"][0], 0.6, 0.2
    far, near = 20.0, half_width
    corners = [
        (-far, near, -near, far),
        (near, near, far, far),
        (-far, -far, -near, -near),
        (near, -far, far, -near),
    ]
    boxes = corners if crossing else [(-far, near, far, far), (-far, -far, far, -near)]
    walls = [Shape.polygon([np.array([[a, b], [c, b], [c, d], [a, d]])]) for a, b, c, d in boxes]
    plan = GroundPlan(obstacles=tuple(walls), radius=radius, resolution=0.1)
    ground = built(plan, Area(np.full(2, -far), np.full(2, far)), np.zeros((3, 1)))
    starts, goals = {}, {}
    for i in range(3):
        first, last = 8.0 + 1.5 * i, 8.0 + 1.5 * (2 - i)
        starts[f"a{i}"], goals[f"a{i}"] = np.array([-first, 0.0, 0.0, 0.0]), np.array([last, 0.0, 0.0])
        if crossing:
            starts[f"b{i}"] = np.array([0.0, -first, 0.0, math.pi / 2])
            goals[f"b{i}"] = np.array([0.0, last, 0.0])
        else:
            starts[f"b{i}"], goals[f"b{i}"] = (
                np.array([first, 0.0, 0.0, math.pi]),
                np.array([-last, 0.0, 0.0]),
            )
    crowd = Crowd(dict.fromkeys(starts, vehicle), starts, goals, separation, ground=ground)
    outcome = check(crowd, 60.0)
    assert outcome.diverted > 0
    places = outcome.tracks.reshape(-1, 3)[:, :2].T.copy()
    assert min(wall.distances(places).min() for wall in walls) >= radius


def test_drones_turn_aside_inside_a_keep_out_zone_neither_in_2d_nor_in_3d():
    vehicle = CASES["point_mass"][0]
    # Two pillars beside the way on which they meet: the only room to pass is beyond them.
    zones = (Shape.disc(0.0, -6.0, 4.0), Shape.disc(0.0, 6.0, 4.0))
    for level in (True, False):
        area = Area(np.full(2 if level else 3, -40.0), np.full(2 if level else 3, 40.0))
        plan = GroundPlan(keep_out=zones, radius=0.3, resolution=0.5)
        ground = built(plan, area, np.zeros((3, 1)))
        starts = {"a": np.array([-30.0, 0.0, 5.0, 0.0]), "b": np.array([30.0, 0.0, 5.0, 0.0])}
        goals = {"a": np.array([30.0, 0.0, 5.0]), "b": np.array([-30.0, 0.0, 5.0])}
        crowd = Crowd(dict.fromkeys(starts, vehicle), starts, goals, 2.0, level=level, ground=ground)
        outcome = check(crowd, 60.0)
        places = outcome.tracks.reshape(-1, 3)[:, :2].T.copy()
        assert min(zone.distances(places).min() for zone in zones) >= 0.3


def test_the_same_crowd_gives_the_same_bits():
    crowd, _ = on_a_ring("point_mass", 4, loss=0.2)
    one, two = run(crowd, 12.0), run(crowd, 12.0)
    assert (one.tracks == two.tracks).all()
    assert one.diverted == two.diverted > 0


@pytest.mark.parametrize("kind", ["point_mass", "quadrotor"])
def test_between_layers_drones_turn_aside_neither_into_what_is_below_nor_into_what_is_above(kind):
    """They meet one a little higher than the other, and would pass above and below if there were room."""
    vehicle, separation, *_ = CASES[kind]
    half, radius = 0.6 * separation, 0.3
    slab = np.array([[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]])
    height = 20.0
    obstacles = tuple(
        Shape.polygon([slab], altitude) for altitude in ((0.0, height - half), (height + half, 40.0))
    )
    area = Area(np.array([-60.0, -60.0, 0.0]), np.array([60.0, 60.0, 40.0]))
    plan = GroundPlan(obstacles=obstacles, radius=radius, resolution=2.0, layer=0.1)
    aside = 0.6 * (half - radius)
    starts = {
        "a": np.array([-50.0, 0.0, height + aside, 0.0]),
        "b": np.array([50.0, 0.0, height - aside, math.pi]),
    }
    goals = {"a": np.array([50.0, 0.0, height + aside]), "b": np.array([-50.0, 0.0, height - aside])}
    ground = built(plan, area, np.stack([start[:3] for start in starts.values()], axis=1))
    assert len(ground.cells) > 400

    crowd = Crowd(dict.fromkeys(starts, vehicle), starts, goals, separation, level=False, ground=ground)
    outcome = check(crowd, 60.0)
    assert outcome.diverted > 0
    assert outcome.trespasses == 0
    x, y, z = outcome.tracks.reshape(-1, 3).T
    between = (np.abs(x) <= 40.0) & (np.abs(y) <= 40.0)
    assert np.abs(z[between] - height).max() <= half - radius + 1e-6
