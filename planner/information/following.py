"""From actions in their order to a plan: the first of them whose way is free and affordable."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from planner.budget import NEAR_M, affordable, returning, truncated
from planner.commitments import heeded
from planner.deadline import Deadline, Reserve
from planner.ground.routes import followed, lifted
from planner.information.actions import ActionSet, part
from planner.maasi.maasi import crowded
from planner.plan import Over, Plan, PlannerSetup, PlanProblem, Trajectory
from planner.separation import Courses, keeps_apart, meets_soon
from planner.vehicles.route import routed

LEAST = 1e-9  # nats: less is no reason to go anywhere
TRIES = 40  # actions whose ways are looked at
WAY_S = 1e-3  # that a way and its checks may take, before they were measured
LATE = "holds: its deadline passed before a free way was found"
POINTLESS = "nothing is to be learnt at any place within its scales"


@dataclass(frozen=True, slots=True)
class Chosen:
    """Actions of one robot in the order in which to try them, with the team's information by each."""

    actions: ActionSet
    order: list[int]
    values: list[float]  # nats, in this order
    without: float  # of what the others have committed to alone
    error: float  # by which a value may be off
    note: str = ""  # for people


class Following:
    """Finds ways, and knows how long it takes."""

    def __init__(self, setup: PlannerSetup, share: float) -> None:
        self.setup = setup
        self.share = share  # of an action's way that a plan goes
        self.reserve = Reserve(WAY_S)

    def __repr__(self) -> str:
        return f"Following({self.share:g} of each way, {self.reserve!r})"

    def plan(self, problem: PlanProblem, chosen: Chosen, deadline: Deadline, *, pointless: bool) -> Plan:
        """The plan of the first action whose way is free and affordable.

        Args:
            pointless: whether to go where nothing is to be learnt too.
        """
        if not pointless and (not chosen.order or max(chosen.values) - chosen.without <= LEAST):
            return self._in_time(problem, deadline, lambda: returning(problem, self.setup, POINTLESS))
        courses: Courses | None = None
        blocked = too_dear = False
        for index, value in list(zip(chosen.order, chosen.values, strict=True))[:TRIES]:
            if not self.reserve.fits(deadline):
                return Plan(None, LATE)
            with self.reserve.measured(deadline):
                courses = courses or Courses.of(heeded(problem.others, problem.robot))
                if blocked and self._meets(problem, chosen.actions, index, courses):
                    continue
                way = self.way(problem, chosen.actions, index, deadline.over)
                if way is None:
                    continue
                if not keeps_apart(problem, self.setup.vehicles[problem.robot], way, courses):
                    blocked = True
                    continue
                if not affordable(problem, self.setup, way):
                    too_dear = True
                    continue
            gain, length = value - chosen.without, float(chosen.actions.lengths[index])
            terms = {"information": gain, "team": value, "error": chosen.error, "length": length}
            place = ", ".join(f"{x:.1f}" for x in chosen.actions.corners[index][:, -1])
            return Plan(way, f"{gain:.3g} nats on {length:.1f} m to ({place}){chosen.note}", gain, terms)
        if too_dear:
            return self._in_time(problem, deadline, lambda: self._truncated(problem, chosen))
        if blocked or self.setup.ground is None:
            return Plan(None, crowded(problem.separation))
        return Plan(None, "holds: its vehicle cannot follow any way without coming too near to an obstacle")

    def _meets(self, problem: PlanProblem, actions: ActionSet, index: int, courses: Courses) -> bool:
        """Whether it is soon known that a way without corners is not free."""
        route = self._route(problem, actions, index)
        return len(route) == 1 and meets_soon(problem, self.setup.vehicles[problem.robot], route[0], courses)

    def _route(self, problem: PlanProblem, actions: ActionSet, index: int) -> FloatArray:
        """Waypoints (r, 3) to the pose after which to plan again."""
        corners = part(actions.corners[index], self.share)[:, 1:]
        route = np.tile(self.setup.vehicles[problem.robot].pose(problem.state)[:3], (corners.shape[1], 1))
        route[:, : len(corners)] = corners.T
        return route

    def way(self, problem: PlanProblem, actions: ActionSet, index: int, over: Over) -> Trajectory | None:
        """The trajectory to the pose after which to plan again; None: none is clear, or it is there."""
        vehicle, ground = self.setup.vehicles[problem.robot], self.setup.ground
        route = self._route(problem, actions, index)
        state, start, period = problem.state, problem.start_time, problem.measure_period
        way: Trajectory | None
        if ground is not None:
            ways = lifted(ground, problem.area.dimension)
            way = followed(ways, vehicle, state, route, start, period, over)
        elif len(route) == 1:
            way = vehicle.trajectory(state, route[0], start, period)
        else:
            way = routed(vehicle, state, route, start, period, near=NEAR_M)
        return way if way is not None and way.end_time > way.start_time else None

    def _in_time(self, problem: PlanProblem, deadline: Deadline, make: Callable[[], Plan]) -> Plan:
        """What needs another way, if there is time for one."""
        if problem.budget.home is None:
            return make()
        if not self.reserve.fits(deadline):
            return Plan(None, LATE)
        with self.reserve.measured(deadline):
            return make()

    def _truncated(self, problem: PlanProblem, chosen: Chosen) -> Plan:
        """As much of the best way as the budget allows."""
        way = self.way(problem, chosen.actions, chosen.order[0], lambda: False)
        some = None if way is None else truncated(problem, self.setup, way)
        if some is None or not keeps_apart(problem, self.setup.vehicles[problem.robot], some):
            return returning(problem, self.setup, "its budget allows no action")
        gain = chosen.values[0] - chosen.without
        return Plan(some, "as far as its budget allows", gain, {"information": gain, "error": chosen.error})


def in_order(values: FloatArray) -> list[int]:
    """Numbers of those that were looked at, the best first."""
    order = np.argsort(-values, kind="stable")
    return [int(i) for i in order if np.isfinite(values[i])]
