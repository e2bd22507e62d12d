"""Robots under guards and nothing else: straight for their goals, with poses that come late."""

import math
from dataclasses import dataclass

import numpy as np

from planner.avoidance.guard import Guard, Sighting

STEP_S = 0.02
POSE_S = 0.2


@dataclass
class Outcome:
    least: float  # metres between any two, ever
    arrived: set[str]  # who was at its goal once
    diverted: int  # decisions to leave the way


def ring(count, radius, height=10.0):
    """Starts (4,) on a circle, facing its centre, and goals (3,) across, by robot."""
    starts, goals = {}, {}
    for i in range(count):
        angle = 2 * math.pi * i / count
        here = radius * np.array([math.cos(angle), math.sin(angle)])
        starts[f"r{i:02d}"] = np.array([*here, height, angle + math.pi])
        goals[f"r{i:02d}"] = np.array([*-here, height])
    return starts, goals


def run(
    vehicle, starts, goals, separation, seconds, *, delay=0.05, level=True, dead=(), silent_after=math.inf
):
    """`dead` robots stand where they start and were heard once; the others fall silent after a while."""
    ids = sorted(starts)
    models = dict.fromkeys(ids, vehicle)
    guards = {robot: Guard(robot, models, separation, level=level) for robot in ids}
    states = {robot: vehicle.begin(vehicle.initial_state(starts[robot]), goals[robot]) for robot in ids}
    steer = dict(goals)
    due = dict.fromkeys(ids, 0.0)
    mail = []
    outcome = Outcome(math.inf, set(), 0)
    for k in range(int(seconds / STEP_S)):
        now = k * STEP_S
        for i, robot in enumerate(ids):
            beat = (k + 3 * i) % round(POSE_S / STEP_S) == 0
            if k == 0 or (beat and robot not in dead and now < silent_after):
                state = states[robot]
                pose, velocity = vehicle.pose(state)[:3], vehicle.velocity(state)
                mail.append((now + delay * (k > 0), robot, Sighting(now, pose, velocity)))
        for _, robot, sighting in [letter for letter in mail if letter[0] <= now + 1e-9]:
            for other in ids:
                if other != robot:
                    guards[other].see(robot, sighting)
        mail = [letter for letter in mail if letter[0] > now + 1e-9]
        for robot in ids:
            if robot in dead:
                continue
            if now + 1e-9 >= due[robot]:
                before = guards[robot].diverted
                aside = guards[robot].decide(now, states[robot], goals[robot])
                steer[robot] = goals[robot] if aside is None else aside
                if before or aside is not None:
                    states[robot] = vehicle.begin(states[robot], steer[robot])
                outcome.diverted += aside is not None
                due[robot] = min(guards[robot].next_wake, now + POSE_S)
            periods = round(STEP_S / vehicle.control_period)
            states[robot] = vehicle.advance(states[robot], steer[robot], periods)
            if vehicle.reached(states[robot], goals[robot]):
                outcome.arrived.add(robot)
        places = np.array([vehicle.pose(states[robot])[:3] for robot in ids])
        gaps = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(len(ids), 1)]
        outcome.least = min(outcome.least, float(gaps.min()))
    return outcome
