"""Whole missions with the vehicles that are not in the quickstart."""

import numpy as np

from agents.mission.mission_file import load
from agents.team import Team
from planner.vehicles.power import WH
from sim.engine.engine import Engine


def watched(name, seed, period, look, duration=None):
    engine = Engine(Team.of(load(name, duration=duration)), seed)
    last = engine.team.mission.duration_s
    for k in range(1, int(last / period)):
        engine.after(period * k, lambda: look(engine))
    engine.run()
    return engine


def test_aircraft_and_point_masses_find_all_within_limits_battery_and_separation():
    robots = {robot.id: robot for robot in load("aircraft").robots}
    nearest = [np.inf]

    def look(engine):
        now = engine.clock.now()
        bodies = {node.name: node.body.vehicle.state(now) for node in engine.robots}
        for name, body in bodies.items():
            table = robots[name].vehicle
            speed = float(np.linalg.norm(body.velocity[:2]))
            if table["kind"] == "fixed_wing":
                assert abs(speed - table["speed_m_s"]) < 1e-6
            else:
                assert speed <= table["speed_m_s"] + 1e-6
            assert body.energy <= robots[name].budget.energy_wh * WH
        places = np.array([body.pose[:3] for body in bodies.values()])
        gaps = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(len(places), 1)]
        nearest[0] = min(nearest[0], float(gaps.min()))

    engine = watched("aircraft", 0, 0.2, look)
    summary = engine.scoreboard.summary()
    assert summary["targets_found"] == 10
    assert nearest[0] >= 10.0


def test_drone_and_turtlebot_of_the_paper_find_all_targets_and_keep_from_the_obstacles():
    """(MA)ASI section 7.1.3: no robot comes nearer to an obstacle than 0.12 m."""
    mission = load("maasi_obstacles")
    discs = np.array([zone.circle for zone in mission.ground.obstacles])
    nearest = [np.inf]

    def look(engine):
        now = engine.clock.now()
        for node in engine.robots:
            place = node.body.vehicle.state(now).pose[:2]
            gaps = np.linalg.norm(discs[:, :2] - place, axis=1) - discs[:, 2]
            nearest[0] = min(nearest[0], float(gaps.min()))

    engine = watched("maasi_obstacles", 0, 0.05, look, duration=60.0)
    assert engine.scoreboard.summary()["targets_found"] == 12
    assert 0.12 <= nearest[0] < 0.5  # and they do come near
