"""Plans are made in a thread of their own, and a planner's defect costs a plan and no robot."""

import asyncio
from typing import Any

import pytest

from agents.machine import Planned, RequestPlan
from agents.process.planning import PlanThread
from planner.plan import Plan


class Fake:
    def __init__(self, outcome: Plan | Exception) -> None:
        self.outcome = outcome

    def plan(self, problem: Any) -> Plan:
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


def asked(outcome: Plan | Exception) -> tuple[Planned, list[str], PlanThread]:
    """The answer to one request, what was complained of, and the thread."""

    async def main() -> tuple[Planned, list[str], PlanThread]:
        answer: asyncio.Future[Planned] = asyncio.get_running_loop().create_future()
        complaints: list[str] = []
        thread = PlanThread(Fake(outcome), answer.set_result, complaints.append)  # type: ignore[arg-type]
        thread.ask(RequestPlan(7, None))  # type: ignore[arg-type]
        assert not answer.done()  # what else is to be done now comes first
        try:
            return await asyncio.wait_for(answer, 10.0), complaints, thread
        finally:
            thread.close()

    return asyncio.run(main())


def test_a_plan_is_answered_with_its_number_and_timed() -> None:
    plan = Plan(None, "holds: all is explored")
    answer, complaints, thread = asked(plan)
    assert answer == Planned(7, plan)
    assert complaints == []
    assert int(thread.took_ms.counts.sum()) == 1


@pytest.mark.parametrize("error", [ValueError("no such place"), ZeroDivisionError("division by zero")])
def test_a_planners_defect_is_told_and_the_robot_holds(error: Exception) -> None:
    answer, (complaint,), _ = asked(error)
    assert answer.number == 7
    assert answer.plan.trajectory is None
    assert str(error) in answer.plan.reason
    assert str(error) in complaint
    assert complaint.endswith("; holding")
