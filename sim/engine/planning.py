"""Planning in virtual time: each robot's planner on its own, or one planner for all who plan at once."""

import time
from collections.abc import Callable
from functools import partial

from agents.health.histogram import Histogram
from planner.plan import Plan, Planner, PlanProblem, TeamPlanner

PLANNING_S = 0.05  # virtual time that a plan takes
Answer = Callable[[Plan], None]


class PlanService:
    """Answers requests after PLANNING_S; a team planner gets all requests of the same instant together."""

    def __init__(
        self, planner: Planner | TeamPlanner, after: Callable[[float, Callable[[], None]], None]
    ) -> None:
        self.plan_ms = Histogram()  # wall time, for the summary only
        self._planner = planner
        self._after = after
        self._waiting: list[tuple[PlanProblem, Answer]] = []

    @property
    def joint(self) -> bool:
        """Whether robots that plan at the same time are planned for together."""
        return isinstance(self._planner, TeamPlanner)

    def request(self, problem: PlanProblem, answer: Answer) -> None:
        """`answer` is called with the plan when it is there."""
        if not self._waiting:
            self._after(0.0, self._solve)  # after all that happens at this very time
        self._waiting.append((problem, answer))

    def _solve(self) -> None:
        waiting, self._waiting = self._waiting, []
        problems = [problem for problem, _ in waiting]
        if isinstance(self._planner, TeamPlanner):
            began = time.perf_counter()
            plans = self._planner.plan_jointly(tuple(problems))
            self.plan_ms.add((time.perf_counter() - began) * 1e3)
        else:
            plans = tuple(self._plan(self._planner, problem) for problem in problems)
        for (_, answer), plan in zip(waiting, plans, strict=True):
            self._after(PLANNING_S, partial(answer, plan))

    def _plan(self, planner: Planner, problem: PlanProblem) -> Plan:
        began = time.perf_counter()
        plan = planner.plan(problem)
        self.plan_ms.add((time.perf_counter() - began) * 1e3)
        return plan
