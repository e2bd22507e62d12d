"""Planners `monte_carlo` and `greedy_paths`: a whole path over the unobserved intensity, and its first part.

Source: Olofsson et al., "Multi-agent informed path planning using the probability hypothesis density", 2020:
the agent-decoupled reward (15), Algorithm 1, section 5. There a centre plans one agent after the other before
the flight; here each robot plans its own path given what the others have committed to, follows a part of it,
and plans anew from what has been observed by then (section 7: long plans are cut to short ones as in MPC).
"""

from collections.abc import Callable
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray, Fraction, IntArray, NonNegative, Positive
from planner.budget import limited, returning, truncated, way_along
from planner.deadline import Deadline, Reserve
from planner.maasi.maasi import crowded, unplannable
from planner.others import Others
from planner.plan import Plan, PlannerSetup, PlanProblem, Trajectory
from planner.sampling.board import Board
from planner.sampling.grid import NO_TARGETS, believed, unobserved
from planner.sampling.scenery import Scenery
from planner.sampling.search import Breeding, Path, greedy, search
from planner.separation import keeps_apart

NEAR_M = 1.0  # a corner is passed within this, or a quarter of a cell
TRIED = 24  # paths whose beginning is checked against the other robots
WAY_S, BOARD_S, GREEDY_S = 1e-3, 1e-3, 1e-3  # that the trajectory and its checks, what is believed in each
# cell, and a greedy path may take, before they were measured
BATCH_S = 5e-4  # that a batch of paths takes, about
LATE = "holds: its deadline was over before it had a path"

NonNegativeCount = Annotated[int, Meta(ge=0)]


class GreedyPathsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The grid, the path and its part that is followed."""

    cell_m: Positive | None = None  # of the grid; none: what is crossed between two measurements
    steps: Count = 40  # of a path, from cell to cell
    follow: Fraction = 0.1  # share of a path that is followed before the next is planned
    undetected: NonNegative = 1.0  # targets beyond the filter's intensity, were nothing explored; v^n of (6)
    turn_deg: Positive | None = None  # between two steps, at most; none: any


class MonteCarloConfig(GreedyPathsConfig, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How many paths are sampled, too."""

    paths: NonNegativeCount = 4000  # sampled for a plan
    threads: Count = 1  # that sample, at most
    generations: NonNegativeCount = 0  # of paths bred from the best
    children: Count = 500  # in each generation
    mutation: Fraction = 0.5  # chance that one point of a child is drawn anew


class GreedyPaths:
    """Planner: always towards the cell with most unobserved, the baseline of section 5.2."""

    Config: ClassVar[type[GreedyPathsConfig]] = GreedyPathsConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: GreedyPathsConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        self._sceneries: dict[str, Scenery] = {}
        self._finish = Reserve(WAY_S, yields=True)
        self._setting, self._greedy = Reserve(BOARD_S), Reserve(GREEDY_S)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The first part of the best path; a hold with the reason where there is none."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s)
        if deadline.over():
            return Plan(None, LATE)
        scenery = self._scenery(problem)
        grid = scenery.grid
        if grid.cells < 2:
            return Plan(None, "holds: the area is smaller than a step")
        steps = self._steps(problem, scenery)
        until = problem.start_time + steps * scenery.step_s
        choosing = deadline.less(self._finish.kept(deadline))
        if not scenery.known(choosing.over) or not self._setting.fits(choosing):
            return Plan(None, LATE)
        others = Others(problem.others, problem)
        with self._setting.measured(deadline):
            everything = believed(problem, grid, self.config.undetected)
        enough = choosing.less(self._setting.seconds + BATCH_S)
        left = unobserved(everything, others, grid, self.setup.sensors, until, enough.over)
        if not left.sum() > NO_TARGETS:
            return _stay(problem, self.setup, "nothing is left to observe: no target is believed anywhere")
        with self._setting.measured(deadline):
            board = scenery.board(left, problem, self.config.turn_deg)
            start = scenery.start(self._pose(problem))
        if start is None:
            return Plan(None, "holds: no place on its ground is open")
        if choosing.over():
            return Plan(None, LATE)
        paths, sampled = self._paths(board, start, steps, problem, choosing)
        if not sampled:
            return Plan(None, LATE)
        paths = [path for path in paths if path.cells.size > 1]
        if not paths:
            return Plan(None, "holds: no step is possible from where it is")
        return self._first_part(problem, scenery, paths, sampled, float(left.sum()), deadline, others)

    def _paths(
        self, board: Board, start: int, steps: int, problem: PlanProblem, deadline: Deadline
    ) -> tuple[list[Path], int]:
        """Paths, best first, and how many were sampled; none if there is no time for any."""
        if not self._greedy.fits(deadline):
            return [], 0
        with self._greedy.measured(deadline):
            return [greedy(board, start, steps)], 1

    def _scenery(self, problem: PlanProblem) -> Scenery:
        known = self._sceneries.get(problem.robot)
        altitude = float(self._pose(problem)[2])
        if known is None or not known.holds_for(problem, altitude):
            ground = known.land if known is not None else None
            known = Scenery(self.setup, problem, self.config.cell_m, altitude, ground)
            self._sceneries[problem.robot] = known
        return known

    def _pose(self, problem: PlanProblem) -> FloatArray:
        return self.setup.vehicles[problem.robot].pose(problem.state)

    def _steps(self, problem: PlanProblem, scenery: Scenery) -> int:
        """Of a path: no more than the budget has metres or seconds for."""
        metres = problem.budget.distance / float(scenery.grid.size.min())
        seconds = problem.budget.time / scenery.step_s
        return int(np.clip(np.ceil(min(metres, seconds)), 1, self.config.steps))

    def _first_part(
        self,
        problem: PlanProblem,
        scenery: Scenery,
        paths: list[Path],
        sampled: int,
        left: float,
        deadline: Deadline,
        others: Others,
    ) -> Plan:
        """The first path whose beginning keeps apart from the others and is within the budget."""
        ahead = max(1, round(self.config.follow * self.config.steps))
        reason = "nowhere to go but where it is"
        begun: set[bytes] = set()
        tried = 0
        for path in paths:
            cells = path.cells[: ahead + 1]
            if cells.tobytes() in begun:
                continue
            begun.add(cells.tobytes())
            tried += 1
            if tried > TRIED or (tried > 1 and not self._finish.fits(deadline)):
                break
            with self._finish.measured(deadline):
                way = self._way(problem, scenery, cells, deadline)
                part = None if way is None else truncated(problem, self.setup, way)
                vehicle = self.setup.vehicles[problem.robot]
                apart = part is not None and keeps_apart(problem, vehicle, part, others.courses)
            if way is None:
                reason = "there is no way to the beginning of its path"
            elif part is None:
                reason = "its budget has nothing left for a path"
            elif not apart:
                reason = crowded(problem.separation).removeprefix("holds: ")
            else:
                place = ", ".join(f"{x:.1f}" for x in part.waypoint)
                words = (
                    f"{path.reward:.2f} targets on a path of {path.cells.size - 1} steps, first to ({place})"
                )
                terms = {"reward": path.reward, "unobserved": left, "paths": float(sampled)}
                return Plan(part, words, path.reward, terms)
        return _stay(problem, self.setup, reason)

    def _way(
        self, problem: PlanProblem, scenery: Scenery, cells: IntArray, deadline: Deadline
    ) -> Trajectory | None:
        """The trajectory along the centres of cells, the first of which the robot is in."""
        route = scenery.route(self._pose(problem), cells, deadline.over)
        if route is None:
            return None
        near = min(NEAR_M, 0.25 * float(scenery.grid.size.min()))
        way = way_along(problem, self.setup, route, near, deadline.over)
        return way if way is not None and way.end_time > way.start_time else None


class MonteCarlo(GreedyPaths):
    """Planner: the best of many paths sampled from the unobserved intensity."""

    Config: ClassVar[type[GreedyPathsConfig]] = MonteCarloConfig
    config: MonteCarloConfig

    def _paths(
        self, board: Board, start: int, steps: int, problem: PlanProblem, deadline: Deadline
    ) -> tuple[list[Path], int]:
        c = self.config
        found, sampled = search(
            board,
            start,
            steps,
            c.paths,
            problem.seed,
            threads=c.threads,
            breeding=Breeding(c.generations, c.children, c.mutation),
            over=deadline.less(BATCH_S).over,
        )
        return (found, sampled) if found else (super()._paths(board, start, steps, problem, deadline))


def _stay(problem: PlanProblem, setup: PlannerSetup, why: str) -> Plan:
    return returning(problem, setup, why) if limited(problem) else Plan(None, f"holds: {why}")
