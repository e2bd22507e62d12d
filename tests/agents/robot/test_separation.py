"""Separation in a whole team: real Robots on a simulated network, whose planner looks out for nobody."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest

from agents.mission.mission import RobotTable, TeamTable
from agents.mission.mission_file import load
from agents.robot.separation import Separation
from agents.team import Team
from agents.wire.messages import PoseMessage
from planner.plan import Plan
from planner.vehicles.quadrotor import Quadrotor
from sim.engine.engine import Engine
from sim.network.conditions import NetworkConditions
from sim.vehicle import SimulatedVehicle

CENTRE, RADIUS = np.array([100.0, 100.0]), 60.0
KINDS = {
    "quadrotor": {"kind": "quadrotor", "speed_m_s": 10.0},
    "point_mass": {"kind": "point_mass", "speed_m_s": 8.0, "acceleration_m_s2": 3.0},
    "unicycle": {"kind": "unicycle", "speed_m_s": 8.0, "acceleration_m_s2": 3.0},
}
LINKS = {
    "good": NetworkConditions(),
    "late": NetworkConditions(delay_s=0.3, jitter_s=0.05),
    "lossy": NetworkConditions(loss=0.4, datagrams=True),
}


class Across:
    """Goes straight to the other side of the circle, whoever is in the way, and holds there."""

    def __init__(self, models):
        self.models = models
        self.goals = {}

    def plan(self, problem):
        model = self.models[problem.robot]
        place = model.pose(problem.state)[:3]
        goal = self.goals.setdefault(problem.robot, np.append(2.0 * CENTRE - place[:2], place[2]))
        if model.reached(problem.state, goal):
            return Plan(None, "holds: it is there")
        return Plan(
            model.trajectory(problem.state, goal, problem.start_time, problem.measure_period), "goes across"
        )


def team_on_a_ring(kind, count, separation=5.0, duration=45.0):
    mission = load("quickstart", duration=duration)
    sensor, robots = {**mission.robots[0].sensor, "period_s": 5.0}, []
    for i in range(count):
        angle = 2.0 * math.pi * i / count + 0.1
        x, y = (CENTRE + RADIUS * np.array([math.cos(angle), math.sin(angle)])).tolist()
        start = [x, y, 10.0, angle + math.pi]
        robots.append(RobotTable(id=f"r{i + 1}", start=start, vehicle=KINDS[kind], sensor=sensor))
    settings = TeamTable(separation_m=separation)
    changed = msgspec.structs.replace(
        mission,
        robots=robots,
        settings=settings,
        stop_when_all_found=False,
        filter={**mission.filter, "particles": 200},  # nobody looks at what is found here
        found=msgspec.structs.replace(mission.found, period_s=5.0),
    )
    team = Team.of(changed)
    return dataclasses.replace(team, planner=Across(team.vehicle_models))


def flown(team, conditions):
    """The least distance between any two ever, and who was within 1 m of its goal in the end."""
    engine = Engine(team, 0, conditions)
    least = [math.inf]

    def look():
        now = engine.clock.now()
        places = np.array([node.body.vehicle.state(now).pose[:3] for node in engine.robots])
        gaps = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(len(places), 1)]
        least[0] = min(least[0], float(gaps.min()))

    for k in range(1, 450):
        engine.after(0.1 * k, look)
    engine.run()
    goals, now = team.planner.goals, engine.clock.now()
    there = {
        node.name
        for node in engine.robots
        if np.linalg.norm(node.body.vehicle.state(now).pose[:2] - goals[node.name][:2]) < 1.0
    }
    return least[0], there


@pytest.mark.parametrize("link", sorted(LINKS))
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_team_on_crossing_ways_keeps_apart_and_arrives_whatever_the_link(kind, link):
    team = team_on_a_ring(kind, 4)
    least, there = flown(team, LINKS[link])
    assert least >= 5.0
    assert there == {robot.id for robot in team.mission.robots}


def test_poses_that_come_two_seconds_late_keep_a_team_apart_and_do_not_stop_it():
    late = NetworkConditions(delay_s=2.0, jitter_s=0.2, datagrams=True)
    team = team_on_a_ring("quadrotor", 4)
    least, there = flown(team, late)
    assert least >= 5.0
    assert there == {robot.id for robot in team.mission.robots}


def test_robots_that_have_heard_nobody_yet_reckon_with_those_who_started_beside_them():
    """Nine seconds pass before the first pose comes; all go for the far side at once, past one centre."""
    late = NetworkConditions(delay_s=9.0, datagrams=True)
    team = team_on_a_ring("quadrotor", 6, duration=12.0)
    least, _ = flown(team, late)
    assert least >= 5.0


def test_without_a_separation_the_same_team_collides():
    least, _ = flown(team_on_a_ring("quadrotor", 4, separation=0.0), None)
    assert least < 1.0


def heard(time, x, velocity=0.0, boot="b0", sequence=0):
    return PoseMessage(
        team="t",
        sender="b",
        boot=boot,
        sequence=sequence,
        time=time,
        pose=np.array([x, 0.0, 0.0, 0.0]),
        velocity=np.array([velocity, 0.0, 0.0]),
        state="moving",
        travelled=0.0,
    )


def keeper():
    model = Quadrotor(Quadrotor.Config())
    vehicle = SimulatedVehicle(model, np.zeros(4), 0.0)
    start = np.zeros(3)
    return model, vehicle, Separation("a", {"a": model, "b": model}, 5.0, level=True, start=start)


def test_a_robot_off_its_way_says_so_at_once_when_it_is_back_and_now_and_then_meanwhile():
    model, vehicle, separation = keeper()
    way = model.trajectory(vehicle.state(0.0).state, np.array([80.0, 0.0, 0.0]), 0.0, 1.0)
    vehicle.follow(way, 0.0)
    separation.follow(way, np.zeros(3))
    diverted, amended = [], []
    for k in range(400):
        now = 0.05 * k
        if k % 4 == 0:
            separation.hear(heard(now, 40.0, sequence=k), now)
        if separation.keep(now, vehicle):
            amended.append(now)
        if separation.diverted:
            diverted.append(now)
    assert diverted
    # About once a second while it is off its way, and when it goes on along it.
    assert (diverted[-1] - diverted[0]) * 0.5 <= len(amended)
    assert any(0.0 < now - diverted[-1] < 0.3 for now in amended)
    assert np.linalg.norm(vehicle.state(20.0).pose[:2] - [80.0, 0.0]) < 0.5


def test_between_decisions_nothing_is_asked_of_the_vehicle():
    _, vehicle, separation = keeper()
    separation.hear(heard(0.0, 400.0), 0.0)
    assert not separation.keep(0.0, vehicle)
    assert separation.next_wake > 5.0

    class Untouchable:
        def __getattr__(self, name):
            raise AssertionError(f"asked for {name}")

    assert not separation.keep(1.0, Untouchable())
    separation.hear(heard(1.2, 8.0, boot="b1"), 1.2)  # started anew somewhere else: looked at at once
    assert separation.next_wake < 1.2
