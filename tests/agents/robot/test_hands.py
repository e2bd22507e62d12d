"""A robot whose vehicle is in other hands makes no plans, and makes one when it is back."""

from dataclasses import replace

import numpy as np

from agents.devices import VehicleState
from agents.machine import Follow, Planned, Publish, RequestPlan
from agents.robot.hands import Hands
from agents.wire.messages import PoseMessage
from tests.agents.fakes import FakeBody, plan_to
from tests.agents.robot.test_robot import Stage


class TakenBody(FakeBody):
    """As FakeBody, but `doing` something else while that is said."""

    doing = ""

    def state(self, now: float) -> VehicleState:
        return replace(super().state(now), able=not self.doing, doing=self.doing)


def taken_stage() -> tuple[Stage, TakenBody]:
    stage = Stage()
    stage.body = body = TakenBody()
    return stage, body


def words(stage: Stage) -> list[str]:
    published = [a.message for _, a in stage.of(Publish) if isinstance(a, Publish)]
    return [message.state for message in published if isinstance(message, PoseMessage)]


def test_it_tells_when_the_vehicle_changes_hands() -> None:
    hands, body = Hands(), VehicleState(0.0, np.zeros(4), np.zeros(3), np.zeros(7), 0.0, True)
    away = replace(body, able=False, doing="taken over")
    assert not hands.turned(body)
    assert hands.turned(away)
    assert (hands.able, hands.doing) == (False, "taken over")
    assert not hands.turned(away)
    assert hands.turned(body)


def test_nothing_is_planned_before_the_vehicle_has_taken_off() -> None:
    stage, body = taken_stage()
    body.doing = "taking off"
    stage.run_until(5.0)
    assert not stage.of(RequestPlan)
    assert set(words(stage)) == {"taking off"}
    assert len(stage.captures()) >= 5  # it measures all the same
    body.doing = ""
    stage.run_until(6.0)
    assert len(stage.of(RequestPlan)) == 1


def test_a_plan_is_dropped_when_somebody_takes_the_vehicle_and_made_anew_when_it_is_back() -> None:
    stage, body = taken_stage()
    stage.run_until(0.05)
    ((_, request),) = stage.of(RequestPlan)
    assert isinstance(request, RequestPlan)
    plan = plan_to(40.0, 0.0, request.problem.state, request.problem.start_time)
    stage.now = request.problem.start_time - 0.1
    stage.step(Planned(request.number, plan))
    stage.run_until(1.5)
    assert body.trajectory is not None
    body.doing = "taken over"
    stage.run_until(4.0)
    assert isinstance(stage.of(Follow)[-1][1], Follow)
    assert body.trajectory is None
    assert len(stage.of(RequestPlan)) == 1
    assert words(stage)[-1] == "taken over"
    body.doing = ""
    stage.run_until(5.0)
    assert len(stage.of(RequestPlan)) == 2
