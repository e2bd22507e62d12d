"""Plans begin where the robot will be, also after an answer that came too late."""

import dataclasses
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.devices import VehicleState
from agents.machine import Heard
from agents.mission.mission_file import load
from agents.robot.departure import PLANNING, Lead, departure, postponed, resumed
from agents.robot.plan_request import RobotSetup, planning_time
from agents.team import Team
from agents.wire.messages import PlanMessage, PoseMessage
from estimator.filter import Area
from planner.ground.build import GroundPlan, built
from planner.ground.routes import trajectory_clear
from planner.ground.shapes import Shape
from planner.vehicles.fixed_wing import FixedWing
from planner.vehicles.quadrotor import Quadrotor
from planner.vehicles.unicycle import Unicycle
from sim.engine.engine import Engine
from sim.vehicle import SimulatedVehicle

QUICKSTART = Path(__file__).resolve().parents[3] / "missions" / "quickstart.toml"
MODELS: dict[str, Any] = {
    "quadrotor": Quadrotor(Quadrotor.Config()),
    "unicycle": Unicycle(Unicycle.Config()),
    "fixed_wing": FixedWing(FixedWing.Config()),
}
START = np.array([0.0, 0.0, 30.0, 0.0])
GOAL = np.array([60.0, 20.0, 30.0])
LEAD = 0.25


def flown(kind: str) -> tuple[Any, SimulatedVehicle, Any]:
    model = MODELS[kind]
    vehicle = SimulatedVehicle(model, START, 0.0)
    way = model.trajectory(model.initial_state(START), GOAL, 0.0, 1.0)
    vehicle.follow(way, 0.0)
    return model, vehicle, way


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("share", [0.2, 0.9, 1.0, 1.05, 1.5])
@pytest.mark.parametrize("lead", [0.25, 1.0])
def test_a_plan_begins_where_the_vehicle_then_is(kind: str, share: float, lead: float) -> None:
    """On its way, when it has arrived, and long after: asked of the very vehicle that goes there."""
    model, vehicle, way = flown(kind)
    now = round(share * way.end_time / 0.005) * 0.005
    start, state = departure(model, now, vehicle.state(now), way, lead)
    assert now + PLANNING * lead <= start <= now + lead + model.control_period
    there = vehicle.state(start)
    np.testing.assert_allclose(model.pose(state), there.pose, atol=1e-6)
    np.testing.assert_allclose(model.velocity(state), there.velocity, atol=1e-6)


@pytest.mark.parametrize("kind", MODELS)
def test_a_plan_begins_after_the_next_way_where_that_is_committed_to_already(kind: str) -> None:
    model, vehicle, way = flown(kind)
    second = model.trajectory(way.end_state, START[:3] + 5.0, way.end_time, 1.0)
    vehicle.follow(second, way.end_time - 0.5)
    now = way.end_time - 0.5
    for lead in (0.3, 1.0, 500.0):
        start, state = departure(model, now, vehicle.state(now), way, lead, following=second)
        other = SimulatedVehicle(model, START, 0.0)
        other.follow(way, 0.0)
        other.follow(second, now)
        np.testing.assert_allclose(model.pose(state), other.state(start).pose, atol=1e-6)
    start, state = departure(model, now, vehicle.state(now), way, second.end_time - now, following=second)
    assert start == second.end_time
    np.testing.assert_array_equal(state, second.end_state)


@pytest.mark.parametrize("kind", ["quadrotor", "unicycle"])
def test_a_robot_that_holds_settles_at_its_waypoint_meanwhile(kind: str) -> None:
    model, vehicle, way = flown(kind)
    now = way.end_time + 0.01
    start, state = departure(model, now, vehicle.state(now), None, LEAD, GOAL)
    np.testing.assert_allclose(model.pose(state), vehicle.state(start).pose, atol=1e-6)


def test_a_plan_that_is_asked_for_in_time_begins_at_the_very_end_of_the_way() -> None:
    model, vehicle, way = flown("quadrotor")
    for early in (LEAD, 0.9 * LEAD):
        now = way.end_time - early
        start, state = departure(model, now, vehicle.state(now), way, LEAD)
        assert start == way.end_time
        np.testing.assert_array_equal(state, way.end_state)


def test_the_lead_grows_with_late_answers_and_comes_back() -> None:
    way = MODELS["unicycle"].trajectory(MODELS["unicycle"].initial_state(START), GOAL, 10.0, 1.0)
    lead = Lead(LEAD)
    lead.asked(9.75)
    assert lead.answered(9.9, way)
    assert lead.seconds == LEAD
    lead.asked(9.75)
    assert not lead.answered(11.75, way)
    assert lead.late == 1
    assert lead.seconds == pytest.approx(3.0)  # the next answer may take as long, and half as long again
    for _ in range(100):
        lead.asked(9.75)
        assert lead.answered(9.9, way)
    assert lead.seconds == LEAD


def test_a_late_plan_is_begun_later_where_the_robot_still_stands_and_dropped_where_it_does_not() -> None:
    model = MODELS["unicycle"]
    rest = model.initial_state(START)
    way = model.trajectory(rest, GOAL, 10.0, 1.0)
    body = VehicleState(13.0, model.pose(rest), np.zeros(3), rest, 0.0, True)
    later = postponed(way, 13.0, body)
    assert later is not None
    assert (later.start_time, later.end_time) == (13.0, way.end_time + 3.0)
    np.testing.assert_array_equal(later.poses, way.poses)
    for times in ("times", "measure_times", "route_times"):
        np.testing.assert_allclose(getattr(later, times), getattr(way, times) + 3.0)
    assert postponed(way, 13.0, dataclasses.replace(body, velocity=np.array([1.0, 0.0, 0.0]))) is None
    gone = body.pose + np.array([3.0, 0.0, 0.0, 0.0])
    assert postponed(way, 13.0, dataclasses.replace(body, pose=gone)) is None


AREA = Area(np.array([-10.0, -30.0]), np.array([80.0, 60.0]))


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize(("south", "free"), [(-3.0, False), (-28.0, True)])
def test_a_robot_that_was_turned_aside_goes_on_unless_a_wall_is_in_the_way(
    kind: str, south: float, free: bool
) -> None:
    model, _, way = flown(kind)
    pose = START + np.array([6.0, -14.0, 0.0, 0.0])  # turned aside to the south
    aside = VehicleState(3.0, pose, np.zeros(3), model.initial_state(pose), 0.0, False)
    north = south + 8.0
    wall = Shape.polygon([np.array([[30.0, south], [32.0, south], [32.0, north], [30.0, north]])])
    plan = GroundPlan(obstacles=(wall,), resolution=0.5, radius=0.5)
    ground = built(plan, AREA, START[:3, None])
    assert trajectory_clear(ground, way)
    straight = resumed(model, 3.0, aside, way, 1.0, AREA, None)
    assert straight is not None
    found = resumed(model, 3.0, aside, way, 1.0, AREA, ground)
    assert trajectory_clear(ground, straight) == free
    assert (found is not None) == free
    if found is not None:
        assert found.start_time == 3.0
        np.testing.assert_array_equal(found.waypoint, GOAL)
        np.testing.assert_array_equal(found.poses, straight.poses)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_the_planner_has_about_the_lead_on_the_walls_clock_and_for_ever_in_virtual_time(speed: float) -> None:
    mission = load(QUICKSTART)
    robot = mission.robots[0].id
    setup = RobotSetup(mission, robot, "b0", MODELS["quadrotor"], {}, {}, plan_lead_s=0.25 * max(1.0, speed))
    assert planning_time(setup) == np.inf
    seconds = planning_time(dataclasses.replace(setup, speed=speed))
    assert 0.5 * setup.plan_lead_s < seconds * speed < setup.plan_lead_s


def fly(seed: int, planning_s: float, seconds: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, float]:
    """The engine after a run with answers that take so long, and how far robots were off their plans."""
    monkeypatch.setattr("sim.engine.planning.PLANNING_S", planning_s)
    mission = load(QUICKSTART)
    apart = msgspec.structs.replace(mission.settings, separation_m=0.0)  # nobody is turned aside
    mission = msgspec.structs.replace(mission, duration_s=seconds, settings=apart)
    engine = Engine(Team.of(mission), seed)
    plans: dict[str, list[PlanMessage]] = {}
    off: list[float] = []
    hear = engine.scoreboard.hear

    def listen(heard: Heard, now: float) -> None:
        message = heard.message
        if isinstance(message, PlanMessage):
            plans.setdefault(message.sender, []).append(message)
        elif isinstance(message, PoseMessage):
            for plan in reversed(plans.get(message.sender, [])):
                if plan.start_time <= message.time:
                    if message.time <= plan.end_time:
                        own = [np.interp(message.time, plan.times, plan.poses[:, i]) for i in range(3)]
                        off.append(float(np.linalg.norm(message.pose[:3] - own)))
                    break
        hear(heard, now)

    engine.scoreboard.hear = listen  # type: ignore[method-assign]
    engine.run()
    assert len(off) > 50
    return engine, max(off)


@pytest.mark.parametrize("planning_s", [0.05, 0.24, 0.9, 3.0])
def test_robots_fly_what_they_committed_to_however_late_their_planner_answers(
    planning_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine, off = fly(2, planning_s, 60.0, monkeypatch)
    late = [node.robot.lead.late for node in engine.robots]
    assert (max(late) > 0) == (planning_s > LEAD)
    assert max(late) <= 12  # the lead grows until plans are in time
    assert off < 0.5
