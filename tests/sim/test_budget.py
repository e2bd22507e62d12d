"""Budgets in virtual time: what a mission allows is never exceeded, and everybody comes home."""

import msgspec
import numpy as np
import pytest

from agents.errors import MissionError
from agents.mission.mission import BudgetTable
from agents.mission.mission_file import load
from agents.team import Team
from planner.vehicles.power import WH
from planner.vehicles.quadrotor import Quadrotor
from sim.engine.engine import Engine


def test_nobody_exceeds_its_budget_and_all_are_home_at_its_end():
    mission = load("quickstart", duration=60.0)
    few = {**mission.filter, "particles": 500}  # nobody looks at what is found here
    mission = msgspec.structs.replace(mission, filter=few)
    budget = BudgetTable(distance_m=250.0, time_s=55.0)
    robots = [msgspec.structs.replace(robot, budget=budget) for robot in mission.robots]
    engine = Engine(Team.of(msgspec.structs.replace(mission, stop_when_all_found=False, robots=robots)), 0)
    engine.run()
    for node, table in zip(engine.robots, robots, strict=True):
        body = node.body.vehicle.state(60.0)
        assert 100.0 < body.travelled <= 250.0
        assert np.linalg.norm(body.pose[:3] - np.array(table.start)) <= 0.5


@pytest.mark.parametrize("kind", ["quadrotor", "unicycle"])
def test_nobody_empties_its_battery_and_all_are_home_at_its_end(kind):
    mission = load("quickstart", duration=86.0)
    few = {**mission.filter, "particles": 500}  # nobody looks at what is found here
    mission = msgspec.structs.replace(mission, filter=few)
    table = {"kind": kind, "speed_m_s": 8.0, "acceleration_m_s2": 4.0}
    table["power"] = {"rest_w": 100.0, "metre_j": 20.0, "climb_j_m": 15.0}
    battery = 3.0 * WH  # 10.8 kJ: at 260 W when moving, some 42 s
    robots = [
        msgspec.structs.replace(robot, vehicle=table, budget=BudgetTable(energy_wh=3.0))
        for robot in mission.robots
    ]
    engine = Engine(Team.of(msgspec.structs.replace(mission, stop_when_all_found=False, robots=robots)), 0)
    away, travelled = [], {}

    def look():
        away.clear()
        for node, robot in zip(engine.robots, robots, strict=True):
            body = node.body.vehicle.state(engine.clock.now())
            home = np.array(robot.start)[: 2 if kind == "unicycle" else 3]
            travelled[robot.id] = body.travelled
            if np.linalg.norm(body.pose[: home.size] - home) > 0.5:
                away.append(robot.id)
                assert body.energy <= battery, f"{robot.id} is still away"

    for second in range(1, 86):
        engine.after(float(second), look)
    engine.run()
    assert not away
    assert min(travelled.values()) > 100.0


def test_a_battery_of_a_vehicle_that_does_not_say_what_it_consumes_is_refused(monkeypatch):
    monkeypatch.delattr(Quadrotor, "power")
    mission = load("quickstart")
    robots = [msgspec.structs.replace(robot, budget=BudgetTable(energy_wh=1.0)) for robot in mission.robots]
    with pytest.raises(MissionError, match=r"robots\[0\].budget.energy_wh: vehicles of kind 'quadrotor'"):
        Team.of(msgspec.structs.replace(mission, robots=robots))
