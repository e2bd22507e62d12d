"""Robots under guards and nothing else: straight for their goals, with poses that come late, or never."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from planner.avoidance.guard import Guard

STEP_S = 0.04
POSE_S = 0.2


@dataclass(frozen=True)
class Crowd:
    """Who is where, wants to go where, and hears what."""

    models: Mapping[str, Any]
    starts: Mapping[str, np.ndarray]  # (4,)
    goals: Mapping[str, np.ndarray]  # (3,)
    separation: float
    level: bool = True
    ground: Any = None
    delay: float = 0.05  # s that every pose is late
    jitter: float = 0.0  # s more that a pose may take: later ones overtake it
    loss: float = 0.0  # share of poses that do not come
    dead: tuple[str, ...] = ()  # they stand where they start, were heard once, and do nothing
    struck: Mapping[str, float] = field(default_factory=dict)  # who halts, not heard any more, and when
    deaf_after: float = math.inf  # then nobody is heard any more
    seed: int = 0


@dataclass
class Outcome:
    least: float = math.inf  # metres between any two, ever
    pair: tuple[str, str, float] | None = None  # who that was and when
    arrived: dict[str, float] = field(default_factory=dict)  # who was at its goal, and when first
    diverted: int = 0  # decisions to leave the way
    trespasses: int = 0  # robots and instants at which the ground was not clear
    tracks: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (steps, robots, 3)


def ring(count, radius, height=10.0, turn=0.0):
    """Starts (4,) on a circle, facing its centre, and goals (3,) across, by robot."""
    starts, goals = {}, {}
    for i in range(count):
        angle = 2 * math.pi * i / count + turn
        here = radius * np.array([math.cos(angle), math.sin(angle)])
        starts[f"r{i:02d}"] = np.array([*here, height, angle + math.pi])
        goals[f"r{i:02d}"] = np.array([*-here, height])
    return starts, goals


def run(crowd: Crowd, seconds: float) -> Outcome:
    """Until all that can have arrived, or so many seconds."""
    rng = np.random.default_rng(crowd.seed)
    ids = sorted(crowd.starts)
    models, goals = crowd.models, crowd.goals
    guards = {
        robot: Guard(robot, models, crowd.separation, level=crowd.level, ground=crowd.ground) for robot in ids
    }
    states = {r: models[r].begin(models[r].initial_state(crowd.starts[r]), goals[r]) for r in ids}
    steer = dict(goals)
    due = dict.fromkeys(ids, 0.0)
    mail: list[tuple[float, str, float, list[float], list[float]]] = []
    outcome, tracks = Outcome(), []
    first, second = np.triu_indices(len(ids), 1)
    awaited = {robot for robot in ids if robot not in crowd.dead and robot not in crowd.struck}
    for k in range(int(seconds / STEP_S)):
        now = k * STEP_S
        struck = {robot for robot in ids if now >= crowd.struck.get(robot, math.inf)} | set(crowd.dead)
        for i, robot in enumerate(ids):
            beat = (
                (k + 3 * i) % round(POSE_S / STEP_S) == 0 and robot not in struck and now < crowd.deaf_after
            )
            if k > 0 and (not beat or rng.uniform() < crowd.loss):
                continue
            late = crowd.delay + rng.uniform() * crowd.jitter if k else 0.0
            pose, velocity = models[robot].pose(states[robot]), models[robot].velocity(states[robot])
            mail.append((now + late, robot, now, pose[:3].tolist(), velocity.tolist()))
        for _, robot, time, position, velocity in [letter for letter in mail if letter[0] <= now + 1e-9]:
            for other in ids:
                if other != robot:
                    guards[other].see(robot, time, position, velocity)
        mail = [letter for letter in mail if letter[0] > now + 1e-9]
        for robot in ids:
            if robot in crowd.dead:
                continue
            model = models[robot]
            if robot in struck:
                if due[robot] < math.inf:
                    due[robot] = math.inf
                    steer[robot] = model.steer(states[robot], model.aim(states[robot]))
            elif now + 1e-9 >= min(due[robot], guards[robot].next_wake):
                before = guards[robot].diverted
                aside = guards[robot].decide(now, states[robot], goals[robot])
                steer[robot] = goals[robot] if aside is None else aside
                if before or aside is not None:
                    states[robot] = model.begin(states[robot], steer[robot])
                outcome.diverted += aside is not None
                due[robot] = guards[robot].next_wake
            states[robot] = model.advance(states[robot], steer[robot], round(STEP_S / model.control_period))
            if robot not in outcome.arrived and model.reached(states[robot], goals[robot]):
                outcome.arrived[robot] = now
        places = np.array([models[r].pose(states[r])[:3] for r in ids])
        tracks.append(places)
        gaps = np.linalg.norm(places[first] - places[second], axis=1)
        if gaps.size and gaps.min() < outcome.least:
            pair = int(gaps.argmin())
            outcome.least, outcome.pair = float(gaps[pair]), (ids[first[pair]], ids[second[pair]], now)
        if crowd.ground is not None:
            dimension = 2 if crowd.level else 3
            outcome.trespasses += int((~crowd.ground.clear(np.ascontiguousarray(places.T[:dimension]))).sum())
        if awaited <= outcome.arrived.keys():
            break
    outcome.tracks = np.array(tracks)
    return outcome
