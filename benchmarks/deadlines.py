"""How late plans with deadlines come: every planner, in the open and on a real map, alone and in crowds.

    python -m benchmarks.deadlines [--planner NAME] [--clock wall]

Time is that of the thread's processor by default: what others do on the machine does not count.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from agents.mission.mission_file import load
from agents.plugins import kinds
from agents.plugins import load as plugin
from agents.team import Team
from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.deadline import Deadline
from planner.ground.routes import lifted, trajectory_to
from planner.plan import Commitment, Intensity, PlannerSetup, PlanProblem, TeamPlanner
from planner.vehicles.quadrotor import Quadrotor
from planner.warm import warmups

DEPOT = Path(__file__).resolve().parents[1] / "missions" / "depot.toml"
PLACES = ("open", "depot")
CROWDS = (1, 5, 50)
DEADLINES_S = (0.001, 0.003, 0.01, 0.03, 0.1)
STARTS = 4  # problems of each scene
TEAMS = (3, 8)  # robots that are planned for at once


@dataclass(frozen=True)
class Late:
    """One plan."""

    planner: str
    place: str
    robots: int
    deadline_s: float
    over_ms: float  # after the deadline; negative: before
    moves: bool  # whether it has a trajectory
    reason: str


@cache
def rehearsed() -> None:
    """Load the kernels of all planners, as robots do before they start: some are needed only now and then."""
    for _, run in warmups():
        run()


@cache
def scene(place: str, robots: int) -> tuple[PlannerSetup, tuple[PlanProblem, ...]]:
    """A team and problems of its first robot, each begun somewhere else."""
    if place == "open":
        area = Area(np.zeros(2), np.full(2, 100.0))
        config = RangeBearing.Config(
            period_s=1.0, range_sigma_m=1.0, bearing_sigma_deg=1.0, reach_m=[8.0, 8.0]
        )
        vehicle: Any = Quadrotor(Quadrotor.Config(speed_m_s=5.0, acceleration_m_s2=3.0))
        sensor: Any = RangeBearing.of(config, area)
        ground, period, apart, shape = None, 1.0, 2.0, [21, 21]
    else:
        mission = load(DEPOT)
        team = Team.of(mission)
        area, ground, period, apart = team.area, team.ground, 0.5, 0.6
        vehicle, sensor = team.vehicle_models["r1"], team.sensor_models["r1"]
        shape = list(mission.exploration.points)
    names = [f"r{i}" for i in range(robots)]
    setup = PlannerSetup(dict.fromkeys(names, vehicle), dict.fromkeys(names, sensor), area, ground)
    rng = np.random.default_rng(robots)
    others = []
    for name in names[1:]:
        way = None
        while way is None:
            state = vehicle.initial_state(np.append(free(rng, setup), 0.0))
            goal = free(rng, setup)
            if ground is None:
                way = vehicle.trajectory(state, goal, 0.0, period)
            else:
                way = trajectory_to(lifted(ground, 2), vehicle, state, goal, 0.0, period)
        others.append(Commitment(name, 0, way.measure_times, way.measure_poses, way.times, way.poses, period))
    problems = []
    for k in range(max(STARTS, *TEAMS)):
        means = np.stack([free(rng, setup)[:2] for _ in range(6)], axis=1)
        points = np.hstack([np.repeat(means, 200, axis=1) + rng.normal(0, 1.0, (2, 1200))])
        problems.append(
            PlanProblem(
                robot="r0",
                state=vehicle.initial_state(np.append(free(rng, setup), 0.5)),
                start_time=2.0,
                measure_period=period,
                clusters=means,
                exploration=Exploration(rng.uniform(0.0, 1.0, shape), area.low, area.high),
                others=tuple(others),
                area=area,
                separation=apart,
                intensity=Intensity(
                    points, np.full(1200, 1 / 200), means, np.tile(np.eye(2), (6, 1, 1)), np.ones(6)
                ),
                seed=k,
            )
        )
    return setup, tuple(problems)


def free(rng: np.random.Generator, setup: PlannerSetup) -> Any:
    """A place (3,) that may be entered, and from which there are ways."""
    middle = np.array([2.0, 2.0, 0.0])
    while True:
        place = np.append(rng.uniform(setup.area.low, setup.area.high), 0.0)
        if setup.ground is None:
            return place
        if setup.ground.clear(place[:2, None])[0] and setup.ground.path(middle[:2], place[:2]) is not None:
            return place


def planners() -> list[str]:
    """Names of all that are installed and can be made."""
    return sorted(kinds("planners"))


def lateness(
    kind: str, place: str, robots: int, clock: Callable[[], float] = time.thread_time
) -> Iterator[Late]:
    """Plans of one planner with every deadline, after one without."""
    setup, problems = scene(place, robots)
    rehearsed()
    setup.sensors["r0"].detection(problems[0].clusters, setup.vehicles["r0"].pose(problems[0].state)[None])
    found = plugin("planners", kind)
    planner = found(found.Config(), setup)
    for one in (planner, getattr(planner, "single", planner)):
        one.deadline = lambda seconds: Deadline(seconds, clock)
    for _ in range(2):  # as before a robot starts: the first plan loads what is left, the second is measured
        planner.plan(replace(problems[0], start_time=1.9, deadline_s=3600.0))
    for k, deadline in enumerate(DEADLINES_S):
        for i, problem in enumerate(problems[:STARTS]):
            given = replace(problem, deadline_s=deadline, start_time=2.0 + 0.01 * (k * STARTS + i))
            began = clock()
            plan = planner.plan(given)
            over = clock() - began - deadline
            yield Late(kind, place, robots, deadline, 1e3 * over, plan.trajectory is not None, plan.reason)


def together(
    kind: str, place: str, robots: int = 3, clock: Callable[[], float] = time.thread_time
) -> Iterator[Late]:
    """Plans of a planner for several robots at once; nothing of one that plans for each by itself."""
    setup, problems = scene(place, robots)
    rehearsed()
    found = plugin("planners", kind)
    planner = found(found.Config(), setup)
    if not isinstance(planner, TeamPlanner):
        return
    for one in (planner, getattr(planner, "single", planner)):
        one.deadline = lambda seconds: Deadline(seconds, clock)
    team = tuple(
        replace(problems[i], robot=f"r{i}", others=(), intensity=problems[0].intensity) for i in range(robots)
    )
    for _ in range(2):
        planner.plan_jointly(tuple(replace(problem, deadline_s=3600.0) for problem in team))
    for deadline in DEADLINES_S:
        for k in range(STARTS):
            given = tuple(replace(p, deadline_s=deadline, start_time=2.0 + 0.01 * k) for p in team)
            began = clock()
            plans = planner.plan_jointly(given)
            over = clock() - began - deadline
            moves = all(plan.trajectory is not None for plan in plans)
            yield Late(kind, place, robots, deadline, 1e3 * over, moves, plans[0].reason)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planner", action="append")
    parser.add_argument("--place", action="append", choices=PLACES)
    parser.add_argument("--robots", action="append", type=int)
    parser.add_argument("--clock", choices=["thread", "wall"], default="thread")
    args = parser.parse_args()
    clock = time.thread_time if args.clock == "thread" else time.perf_counter
    for kind in args.planner or planners():
        for place in args.place or PLACES:
            for robots in args.robots or CROWDS:
                show(f"{kind:26s} {place:6s} {robots:5d} ", list(lateness(kind, place, robots, clock)))
            for robots in TEAMS:
                show(f"{kind:26s} {place:6s} {robots} joint", list(together(kind, place, robots, clock)))


def show(title: str, rows: list[Late]) -> None:
    """A line: the worst overrun with each deadline, and how many of the plans have a trajectory."""
    if not rows:
        return
    cells = []
    for deadline in DEADLINES_S:
        own = [row for row in rows if row.deadline_s == deadline]
        worst, moved = max(row.over_ms for row in own), sum(row.moves for row in own)
        cells.append(f"{worst:8.2f} ({moved})")
    print(title + " ".join(cells), flush=True)


if __name__ == "__main__":
    main()
