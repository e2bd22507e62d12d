"""Budgets in virtual time: what a mission allows is never exceeded, and everybody comes home."""

import msgspec
import numpy as np

from agents.mission import BudgetTable
from agents.mission_file import load
from agents.team import Team
from sim.engine import Engine


def test_nobody_exceeds_its_budget_and_all_are_home_at_its_end():
    mission = load("quickstart", duration=60.0)
    budget = BudgetTable(distance_m=250.0, time_s=55.0)
    robots = [msgspec.structs.replace(robot, budget=budget) for robot in mission.robots]
    engine = Engine(Team.of(msgspec.structs.replace(mission, stop_when_all_found=False, robots=robots)), 0)
    engine.run()
    for node, table in zip(engine.robots, robots, strict=True):
        body = node.body.vehicle.state(60.0)
        assert 100.0 < body.travelled <= 250.0
        assert np.linalg.norm(body.pose[:3] - np.array(table.start)) <= 0.5
