"""The thread in which a robot process plans, so that its loop goes on meanwhile."""

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from agents.health.histogram import Histogram
from agents.machine import Planned, RequestPlan
from planner.plan import Plan, Planner, PlanProblem


class PlanThread:
    """One planner's. `took_ms` counts how long its plans took."""

    def __init__(
        self, planner: Planner, answer: Callable[[Planned], None], complain: Callable[[str], None]
    ) -> None:
        """`answer` is called in the event loop with each plan.

        A planner's defect must not stop the robot: `complain` is told of it, and the answer is to hold.
        """
        self.took_ms = Histogram()
        self._planner = planner
        self._answer = answer
        self._complain = complain
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="planner")

    def ask(self, request: RequestPlan) -> None:
        """Begin a plan, once what else is to be done now is done.

        A set taken at the same instant is sent before the planner competes with that for the GIL.
        """
        asyncio.get_running_loop().call_soon(self._begin, request)

    def close(self) -> None:
        """No plan is begun any more; one that was goes on and is not waited for."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _begin(self, request: RequestPlan) -> None:
        future = asyncio.get_running_loop().run_in_executor(self._pool, self._plan, request.problem)
        future.add_done_callback(partial(self._planned, request.number))

    def _plan(self, problem: PlanProblem) -> Plan:
        began = time.perf_counter()
        plan = self._planner.plan(problem)
        self.took_ms.add((time.perf_counter() - began) * 1e3)
        return plan

    def _planned(self, number: int, future: "asyncio.Future[Plan]") -> None:
        if future.cancelled():
            return
        if (error := future.exception()) is None:
            self._answer(Planned(number, future.result()))
            return
        failed = f"planner failed: {error!r}"
        self._complain(f"{failed}; holding")
        self._answer(Planned(number, Plan(None, failed)))
