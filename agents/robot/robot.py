"""The Robot: a state machine with two asynchronous clocks, one for plans and one for measurements.

It is told what happened and says what to do; see agents.machine for the seam. Plans are asked for ahead of
the trajectory's end, so that the robot never stands still for one, and are conditioned on the other robots'
committed plans. When two robots planned blind to each other, the one later in the mission's order, or the
one that does not hold the task it plans for, plans again, once.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from agents.allocation.allocation import Allocation
from agents.devices import VehicleState
from agents.machine import (
    Action,
    ClockTrust,
    Delayed,
    Event,
    Follow,
    Heard,
    Measured,
    Planned,
    Publish,
    Reckoned,
    RequestPlan,
    Stamp,
)
from agents.robot.belief import Belief
from agents.robot.departure import Lead, postponed, resumed
from agents.robot.hands import Hands
from agents.robot.measure_clock import MeasureClock
from agents.robot.plan_request import RobotSetup, plan_problem
from agents.robot.sets import OwnSets
from agents.robot.words import blind, plan_message, pose_message
from agents.wire.messages import (
    BidMessage,
    MeasurementSetMessage,
    PictureMessage,
    PlanMessage,
    PoseMessage,
    PosteriorMessage,
    RequestMessage,
)
from agents.wire.presence import Presence
from agents.wire.topics import PLAN, POSE, SET
from agents.wire.transport import PeerChange
from estimator.arrays import FloatArray
from planner.plan import Plan, PlanProblem, Trajectory

LATE_FACTOR = 1.5  # a trajectory that takes this much longer than planned is given up
AMENDED = "goes on after it was turned aside"
STAGGER_S = 10.0  # within this all of a large team have planned first, one after the other
RETRY_S = 1.0  # after a plan that holds, the next is asked for this much later
REPLAN_S = 1.0  # when the allocation changes again, no earlier than this after the last plan was asked for


class Robot:
    """One robot's decisions. `step` is the only way in."""

    def __init__(self, setup: RobotSetup, now: float) -> None:
        mission = setup.mission
        self.id = setup.robot
        self.stamp = Stamp(mission.team, setup.robot, setup.boot)
        self.setup = self._setup = setup
        self._mission = mission
        self._area = setup.area or mission.box()
        self._order = [robot.id for robot in mission.robots]
        self._period = setup.periods[setup.robot]
        self.belief = Belief(
            self.id, self._area, tuple(mission.exploration.points), setup.sensors, setup.periods
        )
        self._sets = OwnSets(setup, now)
        self.unacknowledged, self.alone = self._sets.unacknowledged, self._sets.alone
        self.allocation: Allocation | None = None
        if setup.desk is not None and setup.follows_plans:
            self.allocation = Allocation(mission, self.id, setup.desk, setup.sensors, now, setup.patience)
        self._presence = Presence("robot")
        self._task = ""  # that the committed plan is for
        self._first = ""  # the allocation's first task when the last plan was asked for
        self._asked_at = -np.inf
        turn = self._order.index(self.id) * min(setup.stagger_s, STAGGER_S / len(self._order))
        self._trajectory: Trajectory | None = None  # being followed
        self._next: Trajectory | None = None  # committed, begins at its start_time
        self._held: FloatArray | None = None  # what is steered for where no trajectory is left
        self.lead = Lead(setup.plan_lead_s)
        self._plan_at: float = max(now, turn)
        self._late_at = np.inf  # when the trajectory is given up if the robot was turned aside on it
        self._plan_number = 0
        self._awaited: int | None = None  # the request whose answer is awaited
        self._conditioned_on: dict[str, int] = {}
        self._plan_version = -1
        self._replanned_for = -1  # the version that was already replanned on a conflict
        # Were all to measure at once, each set would wait for the others'; nothing is gained by it.
        first = self._plan_at if setup.first_capture is None else setup.first_capture
        own_times = setup.first_capture is not None
        sensor, trigger = setup.sensors[self.id], mission.trigger
        self.measuring = MeasureClock(sensor, self._period, trigger, first, own_times)
        self._pose_at = now
        self._hands = Hands()

    def __repr__(self) -> str:
        return f"Robot({self.id}, {self.state}, plan={self._plan_version}, {self.unacknowledged})"

    @property
    def state(self) -> str:
        """A word or two for people."""
        if not self._setup.follows_plans:
            return "replaying"
        if not self._hands.able:
            return self._hands.doing
        word = "planning" if self._awaited is not None else "holding"
        if self._trajectory is not None:
            word = "moving"
        return f"{word}, alone" if self.alone is not None and self.alone.alone else word

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        times = [self.measuring.at, self._pose_at, self._sets.next_wake()]
        if self._next is not None:
            times.append(self._next.start_time)
        if self._awaited is None and self._setup.follows_plans and self._hands.able:
            times.append(self._plan_at)
        if self.allocation is not None:
            times.append(self.allocation.next_wake())
        return min(times)

    def step(self, now: float, body: VehicleState, events: Sequence[Event]) -> list[Action]:
        """Take in what happened up to `now`, with the vehicle as it is; answer what to do, in order."""
        actions = self._look_after(now, body)
        for event in events:
            if isinstance(event, Heard):
                self._hear(now, event)
            elif isinstance(event, Measured):
                actions += self._take(event)
            elif isinstance(event, Reckoned):
                self._sets.reckoned(event.number)
            elif isinstance(event, Planned):
                actions += self._decide(now, event, body)
            elif isinstance(event, Delayed):
                actions += self._amend(now, body)
            elif isinstance(event, ClockTrust):
                self.measuring.trusted = event.trusted
            elif isinstance(event, PeerChange) and event.peer.role == "robot":
                if self._presence.take(event) is False:
                    self.belief.forget(event.peer.id)
                if self.allocation is not None:
                    self.allocation.peer(now, event)
        actions += self._sets.step(now, self.stamp, self.belief)
        self._progress(now, body)
        actions += self.measuring.measure(now, body.pose, self.belief)
        if self.allocation is not None:
            actions += self._share(self.allocation, now, body)
        if now >= self._plan_at and self._awaited is None and self._setup.follows_plans and self._hands.able:
            actions.append(self._request(now, body))
        if now >= self._pose_at:
            actions.append(self._publish_pose(now, body))
        return actions + self._sets.due(now)

    def _look_after(self, now: float, body: VehicleState) -> list[Action]:
        """A vehicle in other hands follows no plan of ours; once it is back, a new one is made."""
        if self._hands.turned(body):
            self._plan_at, self._pose_at = min(self._plan_at, now), min(self._pose_at, now)
        if body.able or (self._trajectory is None and self._next is None and self._awaited is None):
            return []
        self._trajectory = self._next = self._awaited = None
        self._held, self._plan_at = body.pose[:3], now
        return [Follow(None)]

    # What is heard

    def _hear(self, now: float, event: Heard) -> None:
        message = event.message
        if isinstance(message, PosteriorMessage):
            self.belief.hear_posterior(message, now)
        elif isinstance(message, PictureMessage):
            self.belief.hear_picture(message)
        elif isinstance(message, MeasurementSetMessage):
            self.belief.hear_set(message)
            self._looked(message)
        elif isinstance(message, BidMessage | RequestMessage):
            if self.allocation is not None:
                self.allocation.hear(now, message)
        elif isinstance(message, PoseMessage):
            self.belief.hear_pose(message)
        elif isinstance(message, PlanMessage) and message.sender in self._order:
            self.belief.hear_plan(message)
            self._resolve_conflict(now, message)
        self._sets.hear(now, message)

    def _resolve_conflict(self, now: float, theirs: PlanMessage) -> None:
        """Both planned blind to each other: the one that gives way plans again, once."""
        mine = self._next or self._trajectory
        if mine is None or self._replanned_for == self._plan_version:
            return
        yields = self._order.index(theirs.sender) < self._order.index(self.id)
        if self.allocation is not None:
            yields = self.allocation.yields(self._task, theirs.task, theirs.sender)
        if yields and blind(self.id, self._plan_version, self._conditioned_on, mine, theirs):
            self._replanned_for = self._plan_version + 1
            self._plan_at = now

    # The measure clock

    def _take(self, event: Measured) -> list[Action]:
        self.measuring.next_set(event.next_capture)
        message = MeasurementSetMessage(
            **self.stamp.header(SET, event.capture_time), pose=event.pose, measurements=event.measurements
        )
        self.belief.looked(message.time, self.id, message.pose)
        self._looked(message)
        return self._sets.take(message)

    def _looked(self, message: MeasurementSetMessage) -> None:
        if self.allocation is not None:
            self.allocation.looked(message.time, message.sender, message.pose)

    # The plan clock

    def _share(self, allocation: Allocation, now: float, body: VehicleState) -> list[Action]:
        """Settle with the others who does what; plan anew when the first of the own tasks is another."""

        def view() -> tuple[PlanProblem, Trajectory | None]:
            number, way = self._plan_number, self._trajectory
            problem = plan_problem(self._setup, self.belief, number, now, body, way)
            return problem, self._next or way

        if now >= self._plan_at and self._awaited is None:
            allocation.renew(now)
        actions = allocation.step(now, self.stamp, view)
        if allocation.first != self._first and now >= self._asked_at + REPLAN_S:
            self._plan_at = min(self._plan_at, now)
        return actions

    def _progress(self, now: float, body: VehicleState) -> None:
        if self._next is not None and now >= self._next.start_time:
            self._trajectory, self._next = self._next, None
            self._late_at = self._given_up(self._trajectory)
            self.measuring.waypoint(self._trajectory.start_time)
        trajectory = self._trajectory
        if trajectory is None or self._next is not None:
            return
        if now >= trajectory.end_time and (body.arrived or now >= self._given_up(trajectory)):
            self._trajectory = None
            self._plan_at = min(self._plan_at, now)

    def _given_up(self, trajectory: Trajectory) -> float:
        duration = trajectory.end_time - trajectory.start_time
        return trajectory.start_time + LATE_FACTOR * duration + 1.0

    def _request(self, now: float, body: VehicleState) -> RequestPlan:
        self._plan_number += 1
        self._awaited = self._plan_number
        self.lead.asked(now)
        where = (now, body, self._trajectory, self.lead.seconds, self._held, self._next)
        problem = plan_problem(self._setup, self.belief, self._plan_number, *where)
        self._conditioned_on = {other.robot: other.version for other in problem.others if other.version >= 0}
        if self.allocation is not None:
            self._first, self._asked_at = self.allocation.first, now
            context = {**problem.context, "assignment": self.allocation.assignment()}
            problem = replace(problem, context=context)
        return RequestPlan(self._plan_number, problem)

    def _decide(self, now: float, event: Planned, body: VehicleState) -> list[Action]:
        if event.number != self._awaited:
            return []
        self._awaited = None
        plan, way = event.plan, event.plan.trajectory
        if way is None:
            self._plan_at = now + RETRY_S
            if self._trajectory is not None:
                return []
            self._held = body.pose[:3]
            return [Follow(None)]
        if not self.lead.answered(now, way):
            way = postponed(way, now, body)
            if way is None:  # it is not where the plan begins any more
                self._plan_at = now
                return []
        self._next, self._task, self._held = way, plan.task, way.waypoint
        self._plan_at = max(way.end_time - self.lead.seconds, now)
        self._plan_version += 1
        return [Follow(way), self._publish_plan(now, plan, way)]

    def _amend(self, now: float, body: VehicleState) -> list[Action]:
        """Reckon the rest of the way anew, from where the robot was turned aside to, and tell the others."""
        old = self._trajectory
        if old is None or body.arrived:
            return []
        self._next, self._awaited = None, None  # planned from where it will not be
        setup, way = self._setup, None
        if now < self._late_at:
            area = setup.area or setup.mission.box()
            way = resumed(setup.vehicle, now, body, old, self._period, area, setup.ground)
        if way is None:
            self._trajectory, self._held = None, body.pose[:3]
            self._plan_at = now
            return [Follow(None)]
        self._trajectory, self._held = way, way.waypoint
        self._plan_at = max(way.end_time - self.lead.seconds, now)
        self._plan_version += 1
        return [Follow(way), self._publish_plan(now, Plan(way, AMENDED, task=self._task), way)]

    def _publish_plan(self, now: float, plan: Plan, way: Trajectory) -> Publish:
        header = self.stamp.header(PLAN, now)
        return Publish(PLAN, plan_message(header, self._plan_version, self._conditioned_on, plan, way))

    def _publish_pose(self, now: float, body: VehicleState) -> Publish:
        # All robots say it at the same instants, so that a router sends what it has for each of fifty
        # listeners at once: that costs them a fifth of what as many single messages do.
        period = self._mission.settings.pose_period_s
        self._pose_at = period * (int(now / period + 1e-6) + 1)
        header = self.stamp.header(POSE, body.time)
        return Publish(POSE, pose_message(header, body, self.state))
