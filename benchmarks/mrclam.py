"""Real recordings through one filter at a time: `python -m benchmarks.mrclam --filter lmb`.

All five robots' measurement sets of UTIAS MRCLAM data set 6 go through one filter in the order of their
capture, 18,180 of them. Nothing is taken out of the intensity when a target is found, as `Search` does: the
estimates are the filter's own. Barcodes are not used; sightings of the other robots are clutter that moves.
Sensors are those of missions/mrclam.toml, the filters' tables those of benchmarks/mrclam.toml. With `--found`
the sets go through `Search` instead, as the team does it. `--record` keeps the results for the docs.
"""

import json
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from agents import plugins
from agents.mission import mission_file
from agents.mission.tables import convert
from agents.seeds import generator
from agents.team import Team
from estimator.arrays import FloatArray
from estimator.filter import Area, Clusters, Filter
from estimator.metrics.gospa import gospa, matched
from estimator.sensor import SensorModel
from estimator.sensors.teammates import Teammates

HERE = Path(__file__).resolve().parent
MISSION = HERE.parent / "missions" / "mrclam.toml"
DATA = HERE.parent.parent / "shared" / "data" / "MRCLAM_Dataset6"
RECORD = HERE / "mrclam.json"
CUT_OFF, PERIOD, LAST = 0.5, 1.0, 60.0  # GOSPA's c, m; how often estimates are looked at, s; the last minute


@dataclass(frozen=True, slots=True)
class Set:
    """One measurement set with what its sensor knows: who else is where."""

    time: float  # s
    robot: str
    sensor: SensorModel  # expects teammates
    alone: SensorModel  # does not
    pose: FloatArray  # (4,)
    measurements: FloatArray  # (m, 2)
    teammates: FloatArray  # (2, k) where the other robots are


@dataclass(frozen=True, slots=True)
class Recording:
    """All measurement sets in the order of capture, and the truth."""

    area: Area
    landmarks: FloatArray  # (2, 15)
    sets: Sequence[Set]


@cache
def team(share: float = 1.0) -> Team:
    """That of missions/mrclam.toml, with a share of its p_D."""
    mission = mission_file.load(MISSION)
    for robot in mission.robots:
        robot.sensor["range_gains"] = [share * gain for gain in robot.sensor["range_gains"]]
    return Team.of(mission)


@cache
def recording(share: float = 1.0, teammates: bool = True) -> Recording:
    """Data set 6 through the sensors of missions/mrclam.toml with a share of their p_D, teammates as clutter.

    Raises:
        DataError: if the recording is not there.
    """
    crew = team(share)
    world = crew.world(0)
    raw = []
    for robot in crew.sensor_models:
        vehicle, sensor = crew.vehicle(robot, 0, world), crew.sensor(robot, 0, world)
        number, now = 0, sensor.next_capture(-1.0)
        while now is not None and now < np.inf:
            pose = vehicle.state(now).pose
            raw.append((now, robot, number, pose, sensor.measure(now, pose)))
            number, now = number + 1, sensor.next_capture(now)
    table = settings()["teammates"]
    known = Teammates({}, table["spread_m"], table["rate"] if teammates else 0.0)
    poses = {robot: crew.vehicle(robot, 0, world).state(0.0).pose for robot in crew.sensor_models}
    sets = []
    for now, robot, _, pose, measurements in sorted(raw, key=lambda s: s[:3]):
        poses[robot] = pose
        model = known.expected_by(robot, crew.sensor_models[robot], poses)
        others = np.stack([p[:2] for name, p in sorted(poses.items()) if name != robot], axis=1)
        sets.append(Set(now, robot, model, crew.sensor_models[robot], pose, measurements, others))
    return Recording(crew.area, world.targets(0.0), sets)


@cache
def settings() -> dict[str, Any]:
    """benchmarks/mrclam.toml."""
    return tomllib.loads((HERE / "mrclam.toml").read_text())


@dataclass
class Course:
    """Estimates over time and what they came to."""

    truth: FloatArray  # (2, n)
    times: list[float] = field(default_factory=list)
    masses: list[float] = field(default_factory=list)  # expected cardinality, undetected targets included
    tracked: list[float] = field(default_factory=list)  # expected cardinality of the clusters or tracks
    estimates: list[FloatArray] = field(default_factory=list)  # (2, k) each
    gospas: list[float] = field(default_factory=list)
    sets: int = 0
    seconds: float = 0.0  # in the filter: predict and update
    extraction_s: float = 0.0

    def see(self, now: float, mass: float, tracked: float, estimates: FloatArray) -> None:
        """Take in the estimates of one instant."""
        self.times.append(now)
        self.masses.append(mass)
        self.tracked.append(tracked)
        self.estimates.append(estimates)
        self.gospas.append(gospa(self.truth, estimates, c=CUT_OFF, p=2.0).total)

    def errors(self) -> FloatArray:
        """(t, n) distance of each landmark's estimate at each instant, NaN if none is within 0.25 m."""
        out = np.full((len(self.times), self.truth.shape[1]), np.nan)
        for row, estimates in zip(out, self.estimates, strict=True):
            for i, j in matched(self.truth, estimates, CUT_OFF / 2):
                row[i] = float(np.linalg.norm(self.truth[:, i] - estimates[:, j]))
        return out

    def last(self) -> slice:
        """The last minute's instants."""
        begin = int(np.searchsorted(self.times, self.times[-1] - LAST))
        return slice(begin, len(self.times))

    def summary(self) -> dict[str, Any]:
        """What is asked of, and known about, the last minute."""
        part = self.last()
        errors = self.errors()[part]
        numbers = np.array([e.shape[1] for e in self.estimates[part]])
        missing = np.isnan(errors).sum(axis=0)
        return {
            "sets": self.sets,
            "ms_per_set": 1e3 * self.seconds / max(self.sets, 1),
            "extraction_ms": 1e3 * self.extraction_s / max(len(self.times), 1),
            "cardinality": [int(numbers.min()), int(numbers.max())],
            "mass": [float(np.min(self.masses[part])), float(np.max(self.masses[part]))],
            "worst_landmark_m": float(np.nanmax(errors)),  # of the instants at which it is estimated
            "mean_error_m": float(np.nanmean(errors)),
            "instants": len(errors),
            "missing": {str(i): int(missing[i]) for i in np.flatnonzero(missing)},  # instants without one
            "gospa_m": [float(np.mean(self.gospas[part])), float(np.max(self.gospas[part]))],
            "errors_m": [
                float(e) for e in np.nanmax(np.append(errors, [[-1.0] * errors.shape[1]], 0), axis=0)
            ],
        }


def estimates(clusters: Clusters, least: float) -> FloatArray:
    """(2, k) the clusters of mass `least` or more, each a target."""
    return clusters.means[:2, clusters.masses >= least]


def run(kind: str, seed: int, until: float = np.inf, table: dict[str, Any] | None = None) -> Course:
    """One pass over the recording's sets up to a time."""
    table = table or settings()[kind]
    plugin = plugins.load("filters", kind)
    filter: Filter[Any] = plugin(convert(table["filter"], plugin.Config))
    data = recording(table.get("p_d_share", 1.0))
    rng = generator(seed, "mrclam", kind)
    state, now, due = filter.init(data.area, rng), 0.0, PERIOD
    course = Course(data.landmarks)
    for each in data.sets:
        if each.time > until:
            break
        began = time.perf_counter()
        state = filter.predict(state, max(each.time - now, 0.0), rng)
        now = max(now, each.time)
        state = filter.update(state, each.sensor, each.pose, each.measurements, rng)
        ended = time.perf_counter()
        course.seconds += ended - began
        course.sets += 1
        if now >= due:
            state, clusters = filter.clusters(state, rng)
            course.extraction_s += time.perf_counter() - ended
            course.see(
                now, filter.mass(state), float(clusters.masses.sum()), estimates(clusters, table["extract"])
            )
            due = now + PERIOD
    return course


def stone_soup(kind: str, seed: int, until: float = np.inf) -> Course:
    """Stone Soup's GM-PHD on the same sets, see `benchmarks.mrclam_stone_soup`."""
    from benchmarks.mrclam_stone_soup import GaussianMixture  # noqa: PLC0415 - imports for seconds

    data, mixture, due = recording(settings()[kind]["p_d_share"]), GaussianMixture(), PERIOD
    course = Course(data.landmarks)
    for each in data.sets:
        if each.time > until:
            break
        began = time.perf_counter()
        mixture.update(each.alone, each.pose, each.measurements, each.teammates)
        course.seconds += time.perf_counter() - began
        course.sets += 1
        if each.time >= due:
            course.see(each.time, mixture.mass, mixture.mass, mixture.estimates(settings()[kind]["extract"]))
            due = each.time + PERIOD
    return course


def search(kind: str, seed: int, until: float = np.inf, table: dict[str, Any] | None = None) -> Course:
    """As `run`, the way the team does it: what is found is taken out of the filter and kept."""
    table = table or settings()[kind]
    crew, data = team(table.get("search_p_d_share", 1.0)), recording(table.get("search_p_d_share", 1.0))
    plugin = plugins.load("filters", kind)
    inner = plugin(convert(table.get("search", table["filter"]), plugin.Config))
    finder = replace(crew, filter=inner).search()
    rng = generator(seed, "mrclam", kind)
    state, due = finder.init(rng), PERIOD
    course = Course(data.landmarks)
    for each in data.sets:
        if each.time > until:
            break
        began = time.perf_counter()
        state = finder.apply(state, each.alone, each.pose, each.measurements, each.time, rng, each.robot)
        course.seconds += time.perf_counter() - began
        course.sets += 1
        if each.time >= due:
            found = state.found[:2]
            course.see(each.time, finder.expected_cardinality(state), float(found.shape[1]), found)
            due = each.time + PERIOD
    return course


def curve(course: Course, instants: Sequence[float] = (10, 30, 60, 120, 240, 480, 720, 890)) -> Iterator[str]:
    """Cardinality and GOSPA on the way."""
    for instant in instants:
        i = int(np.searchsorted(course.times, instant))
        if i < len(course.times):
            yield (
                f"{course.times[i]:.0f} s: {course.estimates[i].shape[1]} of mass {course.masses[i]:.2f}"
                f" ({course.tracked[i]:.2f} in clusters), GOSPA {course.gospas[i]:.3f} m"
            )


def show(name: str, course: Course, console: Console) -> None:
    """For people at a terminal."""
    table = Table(title=f"{name}: the last minute", show_header=False)
    for key, value in course.summary().items():
        shown = [round(v, 3) for v in value] if isinstance(value, list) else value
        table.add_row(key, f"{shown:.4g}" if isinstance(shown, float) else str(shown))
    console.print(table)
    for line in curve(course):
        console.print(line)


def main(
    filter: Annotated[list[str], typer.Option(help="smc_phd, gm_phd, lmb, stonesoup. Repeatable.")] = [],  # noqa: B006
    seed: Annotated[list[int], typer.Option(help="Repeatable.")] = [0],  # noqa: B006
    until: Annotated[float, typer.Option(help="Team time at which to stop, s.")] = float("inf"),
    record: Annotated[bool, typer.Option(help="Keep the results in benchmarks/mrclam.json.")] = False,
    found: Annotated[bool, typer.Option(help="As the team does: take out what is found.")] = False,
) -> None:
    """Run filters on the recording and show what they came to."""
    console = Console()
    for name in filter or ["smc_phd", "gm_phd", "lmb"]:
        for s in seed:
            way = stone_soup if name == "stonesoup" else search if found else run
            course = way(name, s, until)
            show(f"{name}, seed {s}", course, console)
            if record:
                keep(name + (" in Search" if found else ""), s, course)


def keep(name: str, seed: int, course: Course) -> None:
    """Put a result into the record, in place of an older one of the same name and seed."""
    kept = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    kept[f"{name}, seed {seed}"] = {"until_s": course.times[-1], **course.summary()}
    RECORD.write_text(json.dumps(dict(sorted(kept.items())), indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
