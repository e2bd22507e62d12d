"""What there is to do, made from a robot's belief: clusters to refine, regions to explore, requests to meet.

Robots that share their tasks must mean the same by a task's name although they believe different things: each
has heard other sets, and at another time. So names come from places and not from the order of events. Regions
are named by the fixed cuts of the area (see `regions`), requests by the operator. A cluster is named by the
cell of a grid in which it first turned up, and keeps that name while it moves (see `identity`). Where two
robots have named one cluster differently, both take the name that is first in order as soon as they hear of
each other's. A robot that knows nothing of the past names nearly all things as the others do.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from estimator.arrays import FloatArray
from estimator.exploration import Exploration
from planner.allocation.identity import matched
from planner.allocation.regions import Regions
from planner.plan import Intensity

Kind = Literal["refine", "explore", "request"]
FEWEST = 0.5  # of the regions at the start that there are at the end
MOST = 256  # tasks of one robot; the least of them are left out


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One thing to do at one place."""

    name: str  # "refine-3.7", "explore-12", "request-door"
    kind: Kind
    place: FloatArray  # (d,) metres: the middle
    radius: float  # metres: the standard deviation of its points about the middle, over all axes
    mass: float  # expected targets to refine, unexplored share of the area, or the request's worth
    points: FloatArray  # (d, n) what it stands for: cluster means, grid points, the place
    weights: FloatArray  # (n,) masses of these
    covariances: FloatArray  # (n, d, d) m^2 of clusters; (0, d, d) of others
    robots: int = 1  # that it needs at once
    needs: tuple[str, ...] = ()  # what a robot must be able to do, beside tasks of this kind


@dataclass(frozen=True, slots=True)
class Request:
    """An operator's wish that robots look at a place."""

    name: str  # another than any cluster's or region's: begins with "request-"
    place: FloatArray  # (d,)
    worth: float = 1.0  # in expected targets
    robots: int = 1
    needs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TaskRules:
    """How tasks are made."""

    regions: int = 4  # to explore when nothing is explored, to within a factor of 1.4
    unexplored: float = 0.02  # share of the area below which nothing is left to explore
    least_exploration: float = 0.05  # of a grid point below which it counts as explored
    overlooked: float = 0.2  # expected targets below which none is looked for where all is explored
    leftover: float = 1e-4  # share of the area below which nothing is looked at again
    spacing: float = 10.0  # clusters nearer than this are one task, m

    @property
    def cell(self) -> float:
        """Metres; two clusters that are nearer than half of it to each other are the same one."""
        return max(self.spacing, 1.0)


def make_tasks(
    rules: TaskRules,
    regions: Regions,
    exploration: Exploration,
    intensity: Intensity,
    requests: Iterable[Request] = (),
    known: Mapping[str, FloatArray] | None = None,
) -> tuple[Task, ...]:
    """All tasks that there are, with names that other robots give them too.

    Left out are clusters and requests with a number that is not finite, requests of a name that another has
    or that could be a slot's, and those that need less than one robot.

    Args:
        rules: of their making.
        regions: of the exploration's grid.
        exploration: what is left to explore.
        intensity: whose clusters are to be refined.
        requests: of operators.
        known: names of clusters, this robot's own of the last time and others', and where they are (d,).
    """
    clusters = _clusters(rules, intensity)
    named = [
        replace(task, name=name)
        for task, name in zip(clusters, _names(rules, clusters, known or {}), strict=True)
    ]
    named += _regions(rules, regions, exploration, intensity)
    named += _requested(requests, exploration.low.size)
    if len(named) > MOST:
        kept = sorted(named, key=lambda task: (task.kind != "request", -task.mass, task.name))[:MOST]
        named = [task for task in named if task in kept]
    return tuple(named)


def _regions(
    rules: TaskRules, regions: Regions, exploration: Exploration, intensity: Intensity
) -> list[Task]:
    """What is left to explore, in shares whose number shrinks with it, but more slowly.

    When there is next to nothing left it is the places where something was overlooked, if anything was.
    """
    points = exploration.nodes()
    weights = exploration.values.ravel()
    weights = np.where(np.isfinite(weights) & (weights >= rules.least_exploration), weights, 0.0)
    weights = weights / max(weights.size, 1)
    total = float(weights[regions.order].sum())
    if total < rules.unexplored:
        weights = _overlooked(rules, exploration, intensity)
        left = float(weights[regions.order].sum())
        if left < rules.leftover:
            return []
        weights, total = weights * (rules.unexplored / left), rules.unexplored
    count = rules.regions * max(float(np.sqrt(total)), FEWEST)
    return [
        replace(_task("explore", points[:, rows], weights[rows]), name=f"explore-{number}")
        for number, rows in regions.shares(weights, count)
    ]


def _overlooked(rules: TaskRules, exploration: Exploration, intensity: Intensity) -> FloatArray:
    """Where targets are still expected that nobody has seen (g,); if none are, where looks were fewest."""
    shape = exploration.values.shape
    expected = np.where(np.isfinite(intensity.weights), intensity.weights, 0.0)
    whole = np.isfinite(intensity.points).all(axis=0) & (expected > 0)
    if float(expected[whole].sum()) < rules.overlooked:
        few = exploration.values.ravel()
        return np.where(np.isfinite(few), few, 0.0) / max(few.size, 1)
    made = np.zeros(exploration.values.size)
    spans = np.maximum(exploration.high - exploration.low, 1e-12)[:, None]
    steps = (np.array(shape) - 1)[:, None]
    places = (intensity.points[:, whole] - exploration.low[:, None]) / spans * steps
    cells = np.clip(np.rint(places).astype(np.int64), 0, steps)
    np.add.at(made, np.ravel_multi_index(tuple(cells), shape), expected[whole])
    return made


def _clusters(rules: TaskRules, intensity: Intensity) -> list[Task]:
    """Clusters that are nearer than the spacing to one another, as one task."""
    whole = (
        np.isfinite(intensity.means).all(axis=0)
        & np.isfinite(intensity.covariances).all(axis=(1, 2))
        & np.isfinite(intensity.masses)
        & (intensity.masses > 0)
    )
    means, masses = intensity.means[:, whole], intensity.masses[whole]
    covariances = intensity.covariances[whole]
    gaps = np.linalg.norm(means[:, :, None] - means[:, None, :], axis=0)
    group = np.full(masses.size, -1)
    for c in range(masses.size):  # heaviest first: each takes what is near it and not taken
        if group[c] < 0:
            group[(gaps[c] <= rules.spacing) & (group < 0)] = c
    return [
        _task("refine", means[:, group == c], masses[group == c], covariances[group == c])
        for c in np.unique(group)
    ]


def _names(rules: TaskRules, clusters: list[Task], known: Mapping[str, FloatArray]) -> list[str]:
    """A name for each cluster: one that it is known by already, else that of its cell."""
    kept: list[tuple[str, FloatArray]] = []
    for name in sorted(known):
        place = known[name]
        if not name.startswith("refine-") or (clusters and place.shape != clusters[0].place.shape):
            continue
        if all(np.linalg.norm(place - other) >= 0.5 * rules.cell for _, other in kept):
            kept.append((name, place))
    cost = np.array([[float(np.linalg.norm(task.place - place)) for _, place in kept] for task in clusters])
    rows = matched(cost.reshape(len(clusters), len(kept)), 3.0 * rules.cell)
    used = {kept[j][0] for j in rows if j >= 0}
    names = []
    for task, j in zip(clusters, rows, strict=True):
        if j >= 0:
            names.append(kept[j][0])
            continue
        cell = "refine-" + ".".join(str(int(x)) for x in np.floor(task.place / rules.cell))
        name, copy = cell, 1
        while name in used:  # the cluster that was named so has moved on
            copy += 1
            name = f"{cell}_{copy}"
        used.add(name)
        names.append(name)
    return names


def _requested(requests: Iterable[Request], dimension: int) -> list[Task]:
    made: list[Task] = []
    for request in requests:
        if "#" in request.name or request.name in {task.name for task in made}:
            continue
        place = np.asarray(request.place, dtype=np.float64)
        if (
            place.shape != (dimension,)
            or not np.isfinite([*place, request.worth]).all()
            or request.robots < 1
        ):
            continue
        task = _task("request", place[:, None], np.array([request.worth]))
        made.append(replace(task, name=request.name, robots=request.robots, needs=request.needs))
    return made


def _task(kind: Kind, points: FloatArray, weights: FloatArray, covariances: FloatArray | None = None) -> Task:
    share = weights / weights.sum() if weights.sum() > 0 else np.full(weights.size, 1.0 / weights.size)
    place = points @ share
    spread = float(np.sqrt((((points - place[:, None]) ** 2).sum(axis=0) * share).sum()))
    d = len(points)
    none = np.zeros((0, d, d)) if covariances is None else covariances
    return Task("", kind, place, spread, float(weights.sum()), points, weights, none)
