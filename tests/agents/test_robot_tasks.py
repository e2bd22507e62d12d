"""A robot whose team shares tasks: what it asks its planner, and when it plans anew."""

import numpy as np

from agents.machine import Planned, Publish, RequestPlan
from agents.wire.messages import BidMessage, PlanMessage
from agents.wire.transport import Peer, PeerChange
from planner.allocation.desk import BidRules
from planner.allocation.tasks import Task
from planner.plan import Plan
from tests.agents.fakes import plan_to
from tests.agents.robot.test_robot import LEAD, Stage, request, sent


class FakeDesk:
    """Two tasks, whose worth a test decides."""

    rules = BidRules(capacity=1, renew_s=0.5, round_s=0.05, heartbeat_s=0.5, silence_s=5.0)

    def __init__(self) -> None:
        self.worth = {"explore-2": 2.0, "explore-3": 1.0}

    def tasks(self, *_: object) -> tuple[Task, ...]:
        none = np.zeros((2, 0))
        return tuple(
            Task(name, "explore", np.zeros(2), 0.0, 1.0, none, np.zeros(0), np.zeros((0, 2, 2)))
            for name in self.worth
        )

    def score(self, *_: object, **__: object) -> "FakeDesk":
        return self

    def gains(self, path: list[str], tasks: list[str]) -> tuple[object, object]:
        return np.array([self.worth[task] for task in tasks]), np.zeros(len(tasks), dtype=int)


def planned(stage: Stage, task: str) -> RequestPlan:
    """The robot asks for a plan, and is given one for a task that takes a minute."""
    asked = request([action for _, action in stage.history if isinstance(action, RequestPlan)][-1:])
    way = plan_to(60, 0, np.zeros(4), stage.now + LEAD)
    stage.step(Planned(asked.number, Plan(way.trajectory, way.reason, task=task)))
    return asked


def asked_at(stage: Stage) -> list[float]:
    return [round(time, 3) for time, _ in stage.of(RequestPlan)]


def test_a_plan_is_asked_for_with_the_own_tasks_and_tells_which_it_is_for() -> None:
    stage = Stage(desk=FakeDesk())
    stage.run_until(0.1)
    asked = planned(stage, "explore-2")
    assert asked.problem.context["assignment"].path == ("explore-2",)
    (message,) = sent([action for _, action in stage.history], PlanMessage)
    assert isinstance(message, PlanMessage)
    assert message.task == "explore-2"


def test_when_the_first_task_becomes_another_it_plans_anew_but_not_more_than_once_a_second() -> None:
    desk = FakeDesk()
    stage = Stage(desk=desk)
    stage.run_until(0.1)
    planned(stage, "explore-2")
    stage.run_until(3.0)
    assert asked_at(stage) == [0.0]  # nothing changed
    desk.worth["explore-3"] = 9.0
    stage.run_until(3.6)
    assert len(asked_at(stage)) == 2
    again = planned(stage, "explore-3")
    assert again.problem.context["assignment"].path == ("explore-3",)
    desk.worth["explore-2"] = 99.0
    first = asked_at(stage)[-1]
    stage.run_until(first + 0.95)
    assert len(asked_at(stage)) == 2
    stage.run_until(first + 1.6)
    assert len(asked_at(stage)) == 3


def test_it_speaks_at_every_heartbeat_and_at_once_to_who_comes() -> None:
    stage = Stage(desk=FakeDesk())
    stage.run_until(4.0)
    said = [t for t, a in stage.of(Publish) if isinstance(a.message, BidMessage)]  # type: ignore[attr-defined]
    assert max(np.diff(said)) <= 0.5 + 1e-9
    assert len(said) <= 10
    stage.now = said[-1] + 0.1
    actions = stage.step(PeerChange(Peer("robot", "r2", "b9"), True))
    assert len(sent(actions, BidMessage)) == 1
