"""The Robot: a state machine with two asynchronous clocks, one for plans and one for measurements.

It is told what happened and says what to do; see agents.machine for the seam. Plans are asked for ahead of
the trajectory's end, so that the robot never stands still for one, and are conditioned on the other robots'
committed plans. When two robots planned blind to each other, the one later in the mission's order plans
again, once.
"""

from collections.abc import Sequence

import numpy as np

from agents.belief import Belief
from agents.devices import VehicleState
from agents.machine import (
    Action,
    ClockTrust,
    Delayed,
    Event,
    Follow,
    Heard,
    Measure,
    Measured,
    Planned,
    Publish,
    RequestPlan,
    Stamp,
)
from agents.messages import (
    MeasurementSetMessage,
    PictureMessage,
    PlanMessage,
    PoseMessage,
    PosteriorMessage,
)
from agents.plan_request import RobotSetup, plan_problem
from agents.topics import PLAN, POSE, SET
from agents.transport import PeerChange
from agents.unacknowledged import Unacknowledged
from planner.maasi.trigger import worth_measuring
from planner.plan import Plan, Trajectory
from planner.vehicles.route import routed

LATE_FACTOR = 1.5  # a trajectory that takes this much longer than planned is given up
NEAR_M = 1.0  # corners of the rest of a way are passed within this
RETRY_S = 1.0  # after a plan that holds, the next is asked for this much later


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
        self._sensor = setup.sensors[setup.robot]
        self._period = setup.periods[setup.robot]
        self.belief = Belief(
            self.id, self._area, tuple(mission.exploration.points), setup.sensors, setup.periods
        )
        self.unacknowledged: Unacknowledged[MeasurementSetMessage] = Unacknowledged(
            setup.boot, mission.settings.reoffer_after_s * max(1.0, setup.patience)
        )
        rank = self._order.index(self.id) if now < setup.stagger_s else 0
        self._trajectory: Trajectory | None = None  # being followed
        self._next: Trajectory | None = None  # committed, begins at its start_time
        self._plan_at: float = now + rank * min(setup.stagger_s, 2.0 / len(self._order))
        self._late_at = np.inf  # when the trajectory is given up if the robot was turned aside on it
        self._plan_number = 0
        self._awaited: int | None = None  # the request whose answer is awaited
        self._conditioned_on: dict[str, int] = {}
        self._plan_version = -1
        self._replanned_for = -1  # the version that was already replanned on a conflict
        # Were all to measure at once, each set would wait for the others'; nothing is gained by it.
        self._measure_at = self._plan_at if setup.first_capture is None else setup.first_capture
        self._imposed = True  # the next measurement is at a waypoint and is always taken
        self._pose_at = now
        self._body: VehicleState | None = None
        self.skipped_measurements = 0
        self.untimed_measurements = 0  # not taken, because nobody could say when
        self._clock_trusted = True

    def __repr__(self) -> str:
        return f"Robot({self.id}, {self.state}, plan={self._plan_version}, {self.unacknowledged})"

    @property
    def state(self) -> str:
        """One word for people."""
        if not self._setup.follows_plans:
            return "replaying"
        if self._trajectory is not None:
            return "moving"
        return "planning" if self._awaited is not None else "holding"

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        times = [self._measure_at, self._pose_at, self.unacknowledged.next_offer()]
        if self._next is not None:
            times.append(self._next.start_time)
        if self._awaited is None and self._setup.follows_plans:
            times.append(self._plan_at)
        return min(times)

    def step(self, now: float, body: VehicleState, events: Sequence[Event]) -> list[Action]:
        """Take in what happened up to `now`, with the vehicle as it is; answer what to do, in order."""
        self._body = body
        actions: list[Action] = []
        for event in events:
            if isinstance(event, Heard):
                self._hear(now, event)
            elif isinstance(event, Measured):
                actions += self._take(event)
            elif isinstance(event, Planned):
                actions += self._decide(now, event)
            elif isinstance(event, Delayed):
                actions += self._amend(now, body)
            elif isinstance(event, ClockTrust):
                self._clock_trusted = event.trusted
            elif isinstance(event, PeerChange) and event.peer.role == "robot" and not event.alive:
                self.belief.forget(event.peer.id)
        self._progress(now, body)
        if now >= self._measure_at:
            actions += self._measure(now)
        if now >= self._plan_at and self._awaited is None and self._setup.follows_plans:
            actions.append(self._request(now, body))
        if now >= self._pose_at:
            actions.append(self._publish_pose(now, body))
        actions += [Publish(SET, message) for message in self.unacknowledged.due(now)]
        return actions

    # What is heard

    def _hear(self, now: float, event: Heard) -> None:
        message = event.message
        if isinstance(message, PosteriorMessage):
            self.belief.hear_posterior(message)
            self.unacknowledged.acknowledge(self.id, message)
        elif isinstance(message, PictureMessage):
            self.belief.hear_picture(message)
        elif isinstance(message, MeasurementSetMessage):
            self.belief.hear_set(message)
        elif isinstance(message, PoseMessage):
            self.belief.hear_pose(message)
        elif isinstance(message, PlanMessage) and message.sender in self._order:
            self.belief.hear_plan(message)
            self._resolve_conflict(now, message)

    def _resolve_conflict(self, now: float, theirs: PlanMessage) -> None:
        """Both planned blind to each other: the later in the mission's order plans again, once."""
        mine = self._next or self._trajectory
        if mine is None or self._replanned_for == self._plan_version:
            return
        blind = (
            theirs.conditioned_on.get(self.id, -1) < self._plan_version
            and self._conditioned_on.get(theirs.sender, -1) < theirs.plan_version
        )
        overlap = theirs.end_time > mine.start_time and mine.end_time > theirs.start_time
        yields = self._order.index(theirs.sender) < self._order.index(self.id)
        if blind and overlap and yields:
            self._replanned_for = self._plan_version + 1
            self._plan_at = now

    # The measure clock

    def _measure(self, now: float) -> list[Action]:
        deadline = self._measure_at
        if self._setup.first_capture is not None:
            self._measure_at = np.inf  # the device says when its next set comes
            return [Measure(deadline)]
        missed = max(0, int((now - deadline) / self._period))
        self._measure_at = deadline + (missed + 1) * self._period
        imposed, self._imposed = self._imposed, False
        if not self._clock_trusted:
            self.untimed_measurements += 1
            return []
        trigger = self._mission.trigger
        if trigger.enabled and not imposed and self._body is not None:
            worth = worth_measuring(
                self._sensor,
                self.belief.clusters(),
                self.belief.exploration(),
                self._body.pose,
                trigger.gamma,
                trigger.threshold,
            )
            if not worth:
                self.skipped_measurements += 1
                return []
        return [Measure(deadline)]

    def _take(self, event: Measured) -> list[Action]:
        if event.next_capture is not None:
            self._measure_at = event.next_capture
        message = MeasurementSetMessage(
            **self.stamp.header(SET, event.capture_time), pose=event.pose, measurements=event.measurements
        )
        self.belief.looked(message.time, self.id, message.pose)
        self.unacknowledged.add(message)
        return [Publish(SET, message)]

    # The plan clock

    def _progress(self, now: float, body: VehicleState) -> None:
        if self._next is not None and now >= self._next.start_time:
            self._trajectory, self._next = self._next, None
            self._late_at = self._given_up(self._trajectory)
            if self._setup.first_capture is None:
                self._measure_at = self._trajectory.start_time
                self._imposed = True
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
        problem = plan_problem(self._setup, self.belief, self._plan_number, now, body, self._trajectory)
        self._conditioned_on = {other.robot: other.version for other in problem.others if other.version >= 0}
        return RequestPlan(self._plan_number, problem)

    def _decide(self, now: float, event: Planned) -> list[Action]:
        if event.number != self._awaited:
            return []
        self._awaited = None
        plan = event.plan
        if plan.trajectory is None:
            self._plan_at = now + RETRY_S
            return [] if self._trajectory is not None else [Follow(None)]
        self._next = plan.trajectory
        self._plan_at = max(plan.trajectory.end_time - self._setup.plan_lead_s, now)
        self._plan_version += 1
        return [Follow(plan.trajectory), Publish(PLAN, self._plan_message(now, plan, plan.trajectory))]

    def _amend(self, now: float, body: VehicleState) -> list[Action]:
        """Reckon the rest of the way anew, from where the robot was turned aside to, and tell the others."""
        old = self._trajectory
        if old is None or body.arrived:
            return []
        self._next, self._awaited = None, None  # planned from where it will not be
        if now >= self._late_at:
            self._trajectory = None
            self._plan_at = now
            return [Follow(None)]
        rest = old.route[max(0, int(np.searchsorted(old.route_times, now, side="right")) - 1) :]
        way = routed(self._setup.vehicle, body.state, rest, body.time, self._period, near=NEAR_M)
        self._trajectory = way
        self._plan_at = max(way.end_time - self._setup.plan_lead_s, now)
        self._plan_version += 1
        plan = Plan(way, "goes on after it was turned aside")
        return [Follow(way), Publish(PLAN, self._plan_message(now, plan, way))]

    def _plan_message(self, now: float, plan: Plan, trajectory: Trajectory) -> PlanMessage:
        return PlanMessage(
            **self.stamp.header(PLAN, now),
            plan_version=self._plan_version,
            waypoint=trajectory.waypoint,
            start_time=trajectory.start_time,
            end_time=trajectory.end_time,
            measure_times=trajectory.measure_times,
            measure_poses=trajectory.measure_poses,
            times=trajectory.times,
            poses=trajectory.poses,
            conditioned_on=self._conditioned_on,
            objective=plan.objective,
            reason=plan.reason,
        )

    def _publish_pose(self, now: float, body: VehicleState) -> Publish:
        period = self._mission.settings.pose_period_s
        self._pose_at += period * (1 + max(0, int((now - self._pose_at) / period)))
        message = PoseMessage(
            **self.stamp.header(POSE, body.time),
            pose=body.pose,
            velocity=body.velocity,
            state=self.state,
            travelled=body.travelled,
        )
        return Publish(POSE, message)
