"""`python -m benchmarks.mpc_scenarios`: the 50 m scenarios of Liu & Hedrick (2017), section IV, as a table.

The paper shows seven runs: figure 4, three of figure 5, and three of these again with a wrong first estimate
(figure 6). Field, robot, sensor and noise are the paper's (missions/mpc_search.toml); it does not say where
targets begin, B u, how wide and how wrong the first estimates are, so those are ours.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
import typer

from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.team import Team
from agents.wire.messages import MeasurementSetMessage, Message, PosteriorMessage
from agents.wire.topics import Topic
from sim.engine.engine import Engine
from sim.simulate.simulate import parse_seeds
from sim.simulate.statistics import mean_with_interval


@dataclass(frozen=True)
class Scenario:
    """One of the paper's runs."""

    figure: str
    start: tuple[float, float]  # of the target, m
    velocity: tuple[float, float]  # B u, m/s
    wrong: float = 0.0  # m that the first estimate is off, in a direction that the seed gives


WRONG_M = 3.6
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # rad from one seed's direction to the next
SCENARIOS = (
    Scenario("4", (40, 40), (-0.5, -0.2)),
    Scenario("5a", (40, 12), (-0.3, 0.5)),
    Scenario("5b", (10, 40), (0.6, -0.3)),
    Scenario("5c", (25, 25), (0.4, 0.4)),
    Scenario("6a", (40, 40), (-0.5, -0.2), WRONG_M),
    Scenario("6b", (40, 12), (-0.3, 0.5), WRONG_M),
    Scenario("6c", (10, 40), (0.6, -0.3), WRONG_M),
)


@dataclass(frozen=True)
class Course:
    """What became of one run."""

    first: float | None  # s, of the first look with the target in view
    in_view: float  # share of the looks after it
    longest_loss: float  # s without it in view, after the first
    error: float  # m, root mean square of the estimate's error after the first
    gap: float  # m, mean distance of the robot to the target after the first
    trace: tuple[float, float]  # m^2, of P before the first look with it in view and at the end


def mission_of(scenario: Scenario, seed: int, **planner: object) -> Mission:
    """The mission of a scenario, with other keys of the planner."""
    mission = load("mpc_search")
    east, north = math.cos(GOLDEN * seed), math.sin(GOLDEN * seed)
    estimate = [scenario.start[0] + scenario.wrong * east, scenario.start[1] + scenario.wrong * north]
    changed = {"start_m": estimate, "start_velocity_m_s": list(scenario.velocity)}
    world = {"starts": [list(scenario.start)], "velocities": [list(scenario.velocity)]}
    return msgspec.structs.replace(
        mission,
        name=f"figure_{scenario.figure}",
        world={**mission.world, **world},
        filter={**mission.filter, **changed},
        planner={**mission.planner, **planner},
    )


def run(mission: Mission, seed: int) -> Course:
    """One seed in virtual time."""
    looks: list[tuple[float, bool, float]] = []
    estimates: list[tuple[float, float, float]] = []
    opening = 0.5 * math.radians(mission.robots[0].sensor["angle_deg"])
    reach = mission.robots[0].sensor["range_m"]

    def record(topic: Topic, message: Message) -> None:
        if isinstance(message, MeasurementSetMessage):
            gap = engine.world.targets(message.time)[:, 0] - message.pose[:2]
            off = math.remainder(math.atan2(gap[1], gap[0]) - message.pose[3], 2 * math.pi)
            away = float(np.linalg.norm(gap))
            looks.append((message.time, away <= reach and abs(off) <= opening, away))
        elif isinstance(message, PosteriorMessage):
            means = np.hstack([message.means, message.found])
            spread = np.concatenate([message.covariances, message.found_covariances])
            if means.shape[1]:
                error = np.linalg.norm(means[:, 0] - engine.world.targets(message.time)[:, 0])
                estimates.append((message.time, float(error), float(np.trace(spread[0]))))

    engine = Engine(Team.of(mission), seed, record=record)
    engine.run()
    first = next((time for time, seen, _ in looks if seen), None)
    if first is None:
        return Course(None, 0.0, math.inf, math.inf, math.inf, (estimates[-1][2], estimates[-1][2]))
    after = [look for look in looks if look[0] >= first]
    loss = longest = 0.0
    for (before, _, _), (time, seen, _) in itertools.pairwise(after):
        loss = 0.0 if seen else loss + time - before
        longest = max(longest, loss)
    known = [error for time, error, _ in estimates if time >= first]
    return Course(
        first,
        float(np.mean([seen for _, seen, _ in after])),
        longest,
        float(np.sqrt(np.mean(np.square(known)))),
        float(np.mean([gap for _, _, gap in after])),
        (max((trace for time, _, trace in estimates if time < first), default=math.nan), estimates[-1][2]),
    )


def main(
    seeds: Annotated[str, typer.Option(help="Seeds: 7, 0:20 or 1,5,9.")] = "0:10",
    figures: Annotated[str, typer.Option(help="Which: 4,5a,5b,5c,6a,6b,6c.")] = "",
    standoff: Annotated[float | None, typer.Option(help="standoff_m; 0 is J as printed.")] = None,
) -> None:
    """Print a Markdown table: means over the seeds with 95% intervals."""
    keys = {} if standoff is None else {"standoff_m": standoff}
    heads = [
        "figure",
        "first seen (s)",
        "in view after (%)",
        "least (%)",
        "error (m)",
        "distance (m)",
        "tr P (m²)",
    ]
    print("| " + " | ".join(heads) + " |")
    print("| --- " * len(heads) + "|")
    for scenario in SCENARIOS:
        if figures and scenario.figure not in figures.split(","):
            continue
        runs = [run(mission_of(scenario, seed, **keys), seed) for seed in parse_seeds(seeds)]
        seen = [course for course in runs if course.first is not None]
        if not seen:
            print(f"| {scenario.figure} | never in {len(runs)} runs | | | | | |")
            continue
        cells = [
            _mean([course.first for course in seen if course.first is not None], 1)
            + ("" if len(seen) == len(runs) else f" ({len(seen)} of {len(runs)} runs)"),
            _mean([100 * course.in_view for course in seen], 0),
            f"{100 * min(course.in_view for course in seen):.0f}",
            _mean([course.error for course in seen], 2),
            _mean([course.gap for course in seen], 1),
            f"{np.mean([c.trace[0] for c in seen]):.0f} to {np.mean([c.trace[1] for c in seen]):.2f}",
        ]
        print(f"| {scenario.figure} | " + " | ".join(cells) + " |", flush=True)


def _mean(values: list[float], digits: int) -> str:
    value = mean_with_interval(values)
    half = value["half_width_95"]
    mean = f"{value['mean']:.{digits}f}"
    return mean if half is None else f"{mean} ± {half:.{digits}f}"


if __name__ == "__main__":
    typer.run(main)
