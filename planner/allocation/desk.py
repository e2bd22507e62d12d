"""One robot's part in sharing tasks: which there are, as it believes, and what they are worth to it.

Who does what is settled between the robots (see `cbba`; agents.allocation.allocation carries it over the
network); the planner then takes it as given, as an `Assignment`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from estimator.arrays import FloatArray
from planner.allocation.ability import cruise, sweep_width
from planner.allocation.regions import Regions
from planner.allocation.score import RobotScore
from planner.allocation.tasks import Request, Task, TaskRules, make_tasks
from planner.allocation.valuation import Member, Worth, valued
from planner.plan import Intensity, Over, PlannerSetup, PlanProblem, Trajectory, never


@dataclass(frozen=True, slots=True)
class Assignment:
    """What a robot has to do: `PlanProblem.context["assignment"]`."""

    tasks: tuple[Task, ...]  # all that there are
    path: tuple[str, ...]  # names of the robot's own in the order of execution


@dataclass(frozen=True, slots=True)
class BidRules:
    """How robots talk about their tasks; seconds of team time."""

    capacity: int  # tasks in a bundle, at most
    renew_s: float  # between two looks at what there is to do and what it is worth
    round_s: float  # between two words of a robot, at least
    heartbeat_s: float  # between two words, at most
    silence_s: float  # a robot that nobody has heard for so long is taken for gone


class Desk:
    """Makes tasks and values them for one robot. Remembers nothing but what never changes."""

    def __init__(
        self, robot: str, setup: PlannerSetup, task_rules: TaskRules, worth: Worth, rules: BidRules
    ) -> None:
        self.robot = robot
        self.rules = rules
        self._setup = setup
        self._task_rules = task_rules
        self._worth = worth
        self._regions: tuple[tuple[int, ...], Regions] | None = None
        self._ability: tuple[float, float] | None = None

    def __repr__(self) -> str:
        return f"Desk({self.robot}, {self.rules})"

    def tasks(
        self,
        problem: PlanProblem,
        requests: Iterable[Request] = (),
        known: Mapping[str, FloatArray] | None = None,
    ) -> tuple[Task, ...]:
        """All tasks that there are, from what the problem says of the team's belief.

        Args:
            problem: any of this robot's; only clusters, intensity, exploration and area are looked at.
            requests: of operators.
            known: names of clusters, own of the last time and others', and where they are (d,).
        """
        exploration = problem.exploration
        shape = exploration.values.shape
        if self._regions is None or self._regions[0] != shape:
            nodes = exploration.nodes()
            free = problem.area.is_free(nodes)
            self._regions = (shape, Regions.of(nodes, self._task_rules.regions, free))
        intensity = problem.intensity or bare(problem.clusters)
        return make_tasks(self._task_rules, self._regions[1], exploration, intensity, requests, known)

    def score(
        self,
        problem: PlanProblem,
        tasks: tuple[Task, ...],
        *,
        way: Trajectory | None = None,
        held: str = "",
        capabilities: frozenset[str] | None = None,
        barred: frozenset[str] = frozenset(),
        over: Over = never,
    ) -> RobotScore:
        """What the slots of tasks are worth to the robot, which is free at the end of its way.

        Args:
            problem: of the robot, as of now.
            tasks: all that there are.
            way: that it is on.
            held: the task that it is at.
            capabilities: kinds of tasks that it does, and whatever else tasks may need. None: everything.
            barred: tasks that it has done its part of.
            over: whether time is up: then clusters are valued by shorter paths.
        """
        d = problem.area.dimension
        pose, wait = self._setup.vehicles[self.robot].pose(problem.state), 0.0
        if way is not None and way.end_time > problem.start_time:
            pose, wait = way.end_pose, way.end_time - problem.start_time
        speed, width = self.ability(problem, float(pose[2]))
        budget = problem.budget
        member = Member(
            self.robot,
            np.asarray(pose[:d], dtype=np.float64),
            wait,
            speed,
            width,
            self._setup.sensors[self.robot],
            problem.measure_period,
            float(pose[2]),
            min(budget.time, budget.distance / speed),
            None if budget.home is None else budget.home[:d],
        )
        able = np.array([task.name not in barred for task in tasks], dtype=np.bool_)
        if capabilities is not None:
            able &= np.array([{task.kind, *task.needs} <= capabilities for task in tasks], dtype=np.bool_)
        return valued(member, tasks, self._worth, problem.area, held=held, able=able, over=over)

    def ability(self, problem: PlanProblem, altitude: float) -> tuple[float, float]:
        """The robot's speed (m/s) and the width (m) that its sensor sweeps."""
        if self._ability is None:
            self._ability = (
                cruise(self._setup.vehicles[self.robot], problem.area),
                sweep_width(self._setup.sensors[self.robot], problem.area, altitude),
            )
        return self._ability


@runtime_checkable
class TaskPlanner(Protocol):
    """A planner whose robots share their tasks between them before each plans its own way."""

    def desk(self, robot: str) -> Desk:
        """One robot's part in that."""


def bare(clusters: FloatArray) -> Intensity:
    """Clusters of which only the middles are known: one target each, to be found within metres."""
    d, c = clusters.shape
    ones = np.ones(c)
    return Intensity(clusters, ones, clusters, np.tile(9.0 * np.eye(d), (c, 1, 1)), ones)
