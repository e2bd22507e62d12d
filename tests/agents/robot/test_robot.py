import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from agents.machine import (
    Action,
    Delayed,
    Event,
    Follow,
    Heard,
    Measure,
    Measured,
    Planned,
    Publish,
    RequestPlan,
)
from agents.mission.mission import Mission
from agents.robot.plan_request import RobotSetup
from agents.robot.robot import Robot
from agents.wire.messages import Message, PlanMessage, PoseMessage, Watermark
from agents.wire.topics import PLAN, POSE, POSTERIOR, SET
from agents.wire.transport import Peer, PeerChange
from planner.ground.frame import OPEN, SOLID
from planner.ground.grid_ground import GridGround
from planner.plan import Plan
from tests.agents.fakes import FakeBody, FakeSensor, FakeVehicle, mission, plan_to
from tests.agents.robot.test_unacknowledged import posterior

LEAD = 0.25


class Stage:
    """A robot, its body, and a clock that jumps to the robot's next wake."""

    def __init__(self, robot: str = "r1", the_mission: Mission | None = None, **setup: object) -> None:
        the_mission = the_mission or mission()
        ids = [r.id for r in the_mission.robots]
        self.body = FakeBody()
        self.robot = Robot(
            RobotSetup(
                mission=the_mission,
                robot=robot,
                boot="b1",
                vehicle=FakeVehicle(),
                sensors=dict.fromkeys(ids, FakeSensor()),
                periods=dict.fromkeys(ids, 1.0),
                plan_lead_s=LEAD,
                **setup,  # type: ignore[arg-type]
            ),
            0.0,
        )
        self.now = 0.0
        self.history: list[tuple[float, Action]] = []

    def step(self, *events: Event) -> list[Action]:
        """One step now; measurements are answered at once with empty sets."""
        actions = self.robot.step(self.now, self.body.state(self.now), events)
        self.history += [(self.now, action) for action in actions]
        for action in actions:
            if isinstance(action, Follow):
                self.body.trajectory = action.trajectory
            elif isinstance(action, Measure):
                pose = self.body.state(self.now).pose
                actions = actions + self.step(Measured(self.now, pose, np.zeros((0, 2)), None))
        return actions

    def run_until(self, end: float) -> None:
        """Wake the robot whenever it wants to be woken."""
        while self.robot.next_wake() <= end:
            self.now = max(self.now, self.robot.next_wake())
            self.step()
        self.now = end

    def of(self, kind: type[Action]) -> list[tuple[float, Action]]:
        return [(t, a) for t, a in self.history if isinstance(a, kind)]

    def captures(self) -> list[float]:
        return [t for t, _ in self.of(Measure)]


def sent(actions: Sequence[Action], kind: type[Message]) -> list[Message]:
    return [a.message for a in actions if isinstance(a, Publish) and isinstance(a.message, kind)]


def request(actions: Sequence[Action]) -> RequestPlan:
    (asked,) = [a for a in actions if isinstance(a, RequestPlan)]
    return asked


def their_plan(version: int, start: float, end: float, knew: dict[str, int]) -> Heard:
    message = PlanMessage(
        team="t",
        sender="r1",
        boot="b",
        sequence=version,
        time=start,
        plan_version=version,
        waypoint=np.zeros(3),
        start_time=start,
        end_time=end,
        measure_times=np.array([start]),
        measure_poses=np.zeros((1, 4)),
        times=np.array([start, end]),
        poses=np.zeros((2, 4)),
        conditioned_on=knew,
        objective=0.0,
        reason="",
    )
    return Heard(PLAN, message)


def test_without_a_plan_it_measures_at_its_period_from_the_start() -> None:
    stage = Stage()
    stage.run_until(3.5)
    assert stage.captures() == [0.0, 1.0, 2.0, 3.0]


def test_a_plan_is_followed_and_published_with_what_it_was_conditioned_on() -> None:
    stage = Stage(robot="r2")
    stage.step(their_plan(3, 0.0, 9.0, {}))
    stage.now = 0.2
    asked = request(stage.step())
    assert asked.problem.others[0].robot == "r1"
    actions = stage.step(Planned(asked.number, plan_to(5, 0, np.zeros(4), 0.2 + LEAD)))
    (message,) = sent(actions, PlanMessage)
    assert isinstance(message, PlanMessage)
    assert message.conditioned_on == {"r1": 3}
    assert any(isinstance(a, Follow) and a.trajectory is not None for a in actions)
    stage.run_until(1.0)
    assert stage.robot.state == "moving"


def test_it_measures_at_the_waypoint_and_then_at_its_period() -> None:
    stage = Stage()
    asked = request(stage.step())
    stage.step(Planned(asked.number, plan_to(2.6, 0, np.zeros(4), 0.4)))
    stage.run_until(3.2)
    assert stage.captures() == pytest.approx([0.0, 0.4, 1.4, 2.4])


def test_the_next_plan_is_asked_for_before_the_end_from_where_the_trajectory_will_end() -> None:
    stage = Stage()
    asked = request(stage.step())
    stage.step(Planned(asked.number, plan_to(4, 0, np.zeros(4), LEAD)))
    stage.run_until(4.1)
    when, second = stage.of(RequestPlan)[1]
    assert isinstance(second, RequestPlan)
    assert when == pytest.approx(4.0)
    assert second.problem.start_time == pytest.approx(4.25)
    np.testing.assert_allclose(second.problem.state[:3], [4, 0, 0])


@pytest.mark.parametrize("walled", [False, True])
def test_turned_aside_it_goes_on_around_no_wall_but_stops_and_plans_anew(walled: bool) -> None:
    cells = np.zeros((1, 60, 60), dtype=np.uint8)
    cells[0, 30:39, 29:31] = SOLID if walled else OPEN  # 2 m of wall south of the way, 4.5 to 5.5 m ahead
    ground = GridGround(cells, 0.5, np.array([-10.0, -20.0, 0.0]))
    stage = Stage(ground=ground)
    asked = request(stage.step())
    stage.step(Planned(asked.number, plan_to(15, 0, np.zeros(4), LEAD)))
    stage.run_until(2.0)
    stage.body.trajectory, stage.body.at = None, np.array([2.0, -2.0, 0.0, 0.0])
    actions = stage.robot.step(2.0, dataclasses.replace(stage.body.state(2.0), arrived=False), [Delayed()])
    (follow,) = [action for action in actions if isinstance(action, Follow)]
    if walled:
        assert follow.trajectory is None
        np.testing.assert_allclose(request(actions).problem.state[:3], [2.0, -2.0, 0.0])
    else:
        assert follow.trajectory is not None
        np.testing.assert_allclose(follow.trajectory.waypoint, [15.0, 0.0, 0.0])
        assert sent(actions, PlanMessage)


def test_it_never_stands_still_for_a_plan_that_is_there_in_time() -> None:
    stage = Stage()
    asked = request(stage.step())
    stage.step(Planned(asked.number, plan_to(4, 0, np.zeros(4), LEAD)))
    stage.run_until(4.05)
    asked = stage.of(RequestPlan)[1][1]
    assert isinstance(asked, RequestPlan)
    stage.step(Planned(asked.number, plan_to(4, 4, np.array([4.0, 0, 0, 0]), asked.problem.start_time)))
    stage.run_until(4.3)
    assert stage.robot.state == "moving"
    assert 4.25 in [pytest.approx(t) for t in stage.captures()]


def test_a_plan_that_holds_is_asked_for_again() -> None:
    stage = Stage()
    asked = request(stage.step())
    stage.step(Planned(asked.number, Plan(None, "nowhere to go")))
    assert stage.robot.state == "holding"
    stage.run_until(1.1)
    assert len(stage.of(RequestPlan)) == 2


def test_an_answer_to_an_old_question_is_ignored() -> None:
    stage = Stage()
    asked = request(stage.step())
    assert stage.step(Planned(asked.number - 1, plan_to(5, 0, np.zeros(4), 1.0))) == []
    assert stage.robot.state == "planning"


def test_blind_plans_make_the_later_robot_plan_again_once() -> None:
    stage = Stage(robot="r2")
    stage.now = 0.2
    asked = request(stage.step())
    stage.step(Planned(asked.number, plan_to(9, 0, np.zeros(4), 0.45)))
    again = request(stage.step(their_plan(0, 0.4, 9.0, {})))
    assert {other.robot for other in again.problem.others} == {"r1"}
    stage.step(Planned(again.number, plan_to(0, 9, np.zeros(4), 0.5)))
    assert not [a for a in stage.step(their_plan(1, 0.4, 9.0, {"r2": 0})) if isinstance(a, RequestPlan)]


def test_a_plan_that_knew_of_mine_is_no_conflict() -> None:
    stage = Stage(robot="r2")
    stage.now = 0.2
    asked = request(stage.step())
    stage.step(Planned(asked.number, plan_to(9, 0, np.zeros(4), 0.45)))
    assert not [a for a in stage.step(their_plan(0, 0.4, 9.0, {"r2": 0})) if isinstance(a, RequestPlan)]


def test_a_dead_robots_plan_is_no_longer_planned_around() -> None:
    stage = Stage(robot="r2")
    stage.step(their_plan(0, 0.0, 99.0, {}))
    stage.step(PeerChange(Peer("robot", "r1", "b"), False))
    stage.now = 0.2
    assert request(stage.step()).problem.others == ()


def test_the_late_end_of_a_robots_old_boot_does_not_take_away_its_new_ones_plan() -> None:
    stage = Stage(robot="r2")
    stage.step(PeerChange(Peer("robot", "r1", "a"), True), PeerChange(Peer("robot", "r1", "b"), True))
    stage.step(their_plan(0, 0.0, 99.0, {}))
    stage.step(PeerChange(Peer("robot", "r1", "a"), False))
    stage.now = 0.2
    (theirs,) = request(stage.step()).problem.others
    assert theirs.robot == "r1"
    stage.step(PeerChange(Peer("robot", "r1", "b"), False))
    assert "r1" not in stage.robot.belief.commitments


def test_a_robot_whose_plan_is_unknown_is_planned_around_where_it_stands() -> None:
    stage = Stage()
    pose = PoseMessage(
        team="t",
        sender="r2",
        boot="b",
        sequence=0,
        time=0.0,
        pose=np.array([3.0, 4.0, 0.0, 0.0]),
        velocity=np.zeros(3),
        state="holding",
        travelled=0.0,
    )
    asked = request(stage.step(Heard(POSE, pose)))
    (other,) = asked.problem.others
    np.testing.assert_array_equal(other.poses, [[3.0, 4.0, 0.0, 0.0]])


def test_sets_are_offered_again_until_the_watermark_covers_them() -> None:
    stage = Stage()
    stage.run_until(2.5)
    sequences = [a.message.sequence for _, a in stage.history if isinstance(a, Publish) and a.topic is SET]
    assert sequences == [0, 1, 0, 1, 2]  # at 2 s the old ones are offered before the third is taken
    stage.step(Heard(POSTERIOR, posterior(r1_b1=Watermark(upto=2))))
    assert len(stage.robot.unacknowledged) == 0


def test_event_trigger_skips_looks_that_promise_nothing_but_never_the_one_at_a_waypoint() -> None:
    trigger = {"enabled": True, "gamma": 1.0, "threshold": 4.0}
    stage = Stage(the_mission=mission(trigger=trigger))
    asked = request(stage.step())
    stage.step(Planned(asked.number, plan_to(4, 0, np.zeros(4), LEAD)))
    stage.run_until(3.9)
    assert stage.captures() == [0.0, LEAD]
    assert stage.robot.measuring.skipped == 3


def test_a_device_with_its_own_times_is_asked_at_those() -> None:
    stage = Stage(first_capture=0.3, follows_plans=False)
    assert stage.robot.next_wake() == 0.0
    stage.step()
    assert stage.captures() == []
    stage.now = 0.31
    (asked,) = [
        a for a in stage.robot.step(stage.now, stage.body.state(stage.now), []) if isinstance(a, Measure)
    ]
    assert asked.deadline == 0.3
    stage.robot.step(
        stage.now, stage.body.state(stage.now), [Measured(0.3, np.zeros(4), np.zeros((0, 2)), 0.5)]
    )
    assert stage.robot.state == "replaying"
    assert stage.robot.next_wake() <= 0.5
    assert not stage.of(RequestPlan)


def test_missed_deadlines_are_not_made_up_for() -> None:
    stage = Stage()
    stage.step()
    stage.now = 3.4
    stage.step()
    stage.run_until(4.5)
    assert stage.captures() == [0.0, 3.4, 4.0]
