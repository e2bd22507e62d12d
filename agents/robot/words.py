"""A robot's own messages about its ways, and what it makes of others' plans."""

from collections.abc import Mapping

from agents.devices import VehicleState
from agents.machine import Header
from agents.wire.messages import PlanMessage, PoseMessage
from planner.plan import Plan, Trajectory


def plan_message(
    header: Header, version: int, conditioned_on: Mapping[str, int], plan: Plan, trajectory: Trajectory
) -> PlanMessage:
    """A plan that the robot has committed to."""
    return PlanMessage(
        **header,
        plan_version=version,
        waypoint=trajectory.waypoint,
        start_time=trajectory.start_time,
        end_time=trajectory.end_time,
        measure_times=trajectory.measure_times,
        measure_poses=trajectory.measure_poses,
        times=trajectory.times,
        poses=trajectory.poses,
        conditioned_on=dict(conditioned_on),
        objective=plan.objective,
        reason=plan.reason,
        task=plan.task,
    )


def pose_message(header: Header, body: VehicleState, state: str) -> PoseMessage:
    """Where the robot is and what it is doing, in a word."""
    return PoseMessage(
        **header, pose=body.pose, velocity=body.velocity, state=state, travelled=body.travelled
    )


def blind(
    robot: str, version: int, conditioned_on: Mapping[str, int], mine: Trajectory, theirs: PlanMessage
) -> bool:
    """Whether two plans for overlapping times were made without knowing of each other.

    Args:
        robot: whose plan `mine` is, its `version` conditioned on others' versions.
        theirs: another's plan.
    """
    return (
        theirs.conditioned_on.get(robot, -1) < version
        and conditioned_on.get(theirs.sender, -1) < theirs.plan_version
        and theirs.end_time > mine.start_time
        and mine.end_time > theirs.start_time
    )
