"""What there is to do, made from the posterior: clusters to refine, regions to explore, operators' requests.

Tasks keep their names while the posterior changes: each new one takes the name of the old one of its kind
that it is (by overlap of the unexplored mass for regions, by distance for clusters), so that an allocation
made before still means the same. `TaskBoard` is the frozen state that this needs: the tasks of the last time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from estimator.arrays import FloatArray
from estimator.exploration import Exploration
from planner.allocation.identity import matched
from planner.allocation.partition import Axes, equal_shares
from planner.plan import Intensity

Kind = Literal["refine", "explore", "request"]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One thing to do at one place."""

    name: str  # "refine-3", "explore-0", or the operator's
    kind: Kind
    place: FloatArray  # (d,) metres: the middle
    radius: float  # metres: the standard deviation of its points about the middle, over all axes
    mass: float  # expected targets to refine, unexplored share of the area, or the request's worth
    points: FloatArray  # (d, n) what it stands for: cluster means, grid points, the place
    weights: FloatArray  # (n,) masses of these
    covariances: FloatArray  # (n, d, d) m^2 of clusters; (0, d, d) of others
    robots: int = 1  # that it needs at once


@dataclass(frozen=True, slots=True)
class Request:
    """An operator's wish that somebody look at a place."""

    name: str
    place: FloatArray  # (d,)
    worth: float = 1.0  # in expected targets
    robots: int = 1


@dataclass(frozen=True, slots=True)
class TaskRules:
    """How tasks are made."""

    regions: int = 4  # to explore, at most
    unexplored: float = 0.02  # share of the area below which nothing is left to explore
    least_exploration: float = 0.05  # of a grid point below which it counts as explored
    spacing: float = 10.0  # clusters nearer than this are one task, m
    moved: float = 30.0  # a cluster task that has moved further than this is another, m


@dataclass(frozen=True, slots=True)
class TaskBoard:
    """The tasks of the moment, and what keeps their names."""

    tasks: tuple[Task, ...] = ()
    axes: Axes = field(default_factory=dict)
    region_count: int = 0
    names_given: Mapping[str, int] = field(default_factory=dict)  # by kind

    def renewed(
        self,
        rules: TaskRules,
        exploration: Exploration,
        intensity: Intensity,
        requests: tuple[Request, ...] = (),
    ) -> "TaskBoard":
        """The tasks of a new posterior.

        Left out are clusters and requests with a number that is not finite, requests of a name that another
        has or that could be a slot's, and those that need less than one robot.
        """
        old_regions = [task for task in self.tasks if task.kind == "explore"]
        old_clusters = [task for task in self.tasks if task.kind == "refine"]
        regions, axes, count = _regions(rules, exploration, self.axes, self.region_count)
        clusters = _clusters(rules, intensity)
        given = dict(self.names_given)
        named = _named(clusters, old_clusters, _distances(clusters, old_clusters), rules.moved, given)
        named += _named(regions, old_regions, _strangeness(regions, old_regions), 1.0 - 1e-9, given)
        named += _requested(requests, exploration.low.size)
        return replace(self, tasks=tuple(named), axes=axes, region_count=count, names_given=given)


def churn(before: TaskBoard, after: TaskBoard) -> float:
    """The share of the tasks before that have lost their name, 0 to 1."""
    names = {task.name for task in after.tasks}
    return sum(task.name not in names for task in before.tasks) / max(len(before.tasks), 1)


def _regions(
    rules: TaskRules, exploration: Exploration, axes: Axes, last: int
) -> tuple[list[Task], Axes, int]:
    """Equal shares of the unexplored mass. Their number shrinks with it, but only by a half at a time."""
    points = exploration.nodes()
    weights = exploration.values.ravel()
    weights = np.where(np.isfinite(weights) & (weights >= rules.least_exploration), weights, 0.0)
    weights = weights / max(weights.size, 1)
    total = float(weights.sum())
    if total < rules.unexplored:
        return [], {}, 0
    fitting = max(1, min(rules.regions, round(rules.regions * np.sqrt(total))))
    count = last if fitting <= last <= 2 * fitting else fitting
    labels, axes = equal_shares(points, weights, count, axes)
    made = []
    for label in range(int(labels.max()) + 1):
        rows = labels == label
        made.append(_task("explore", points[:, rows], weights[rows]))
    return made, axes, count


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
            group[(gaps[c] < rules.spacing) & (group < 0)] = c
    return [
        _task("refine", means[:, group == c], masses[group == c], covariances[group == c])
        for c in np.unique(group)
    ]


def _requested(requests: tuple[Request, ...], dimension: int) -> list[Task]:
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
        made.append(replace(task, name=request.name, robots=request.robots))
    return made


def _task(kind: Kind, points: FloatArray, weights: FloatArray, covariances: FloatArray | None = None) -> Task:
    share = weights / weights.sum() if weights.sum() > 0 else np.full(weights.size, 1.0 / weights.size)
    place = points @ share
    spread = float(np.sqrt((((points - place[:, None]) ** 2).sum(axis=0) * share).sum()))
    d = len(points)
    none = np.zeros((0, d, d)) if covariances is None else covariances
    return Task("", kind, place, spread, float(weights.sum()), points, weights, none)


def _distances(new: list[Task], old: list[Task]) -> FloatArray:
    """(new, old) metres between the middles."""
    return np.array([[float(np.linalg.norm(a.place - b.place)) for b in old] for a in new]).reshape(
        len(new), len(old)
    )


def _strangeness(new: list[Task], old: list[Task]) -> FloatArray:
    """(new, old) 1 - the share of two regions' grid points that both have."""
    cost = np.ones((len(new), len(old)))
    sets = [{tuple(p) for p in task.points.T.tolist()} for task in (*new, *old)]
    for i, mine in enumerate(sets[: len(new)]):
        for j, theirs in enumerate(sets[len(new) :]):
            cost[i, j] = 1.0 - len(mine & theirs) / max(len(mine | theirs), 1)
    return cost


def _named(
    new: list[Task], old: list[Task], cost: FloatArray, most: float, given: dict[str, int]
) -> list[Task]:
    """The new tasks, with the names of the old ones that they are."""
    named = []
    for i, j in enumerate(matched(cost, most)):
        task = new[i]
        if j >= 0:
            name = old[j].name
        else:
            number = given.get(task.kind, 0)
            given[task.kind] = number + 1
            name = f"{task.kind}-{number}"
        named.append(replace(task, name=name))
    return named
