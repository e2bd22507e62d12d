"""How a vehicle is driven as the controller foresaw it: one waypoint a step, chosen by its own model.

Vehicles take waypoints, not controls, and each has its own law of driving to them. So for every step the
waypoint is sought after which the vehicle, a step later, has the target most nearly where the plan has it in
the sensor's frame; that weighs heading against position as the sensor does.
"""

import math
from collections.abc import Callable

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import Trajectory, VehicleModel
from planner.vehicles.prediction import SAMPLES, measure_steps
from planner.vehicles.route import LOOK_S

DIRECTIONS = 16
LENGTHS = (0.1, 0.3, 0.7, 1.3, 2.5)  # of waypoints tried, as parts of what is driven in a step at full speed
FINER = 3  # rounds of trying between them


def steered(
    vehicle: VehicleModel,
    state: FloatArray,
    wanted: FloatArray,
    targets: FloatArray,
    *,
    box: tuple[FloatArray, FloatArray],
    step: float,
    speed: float,
    heads: bool,
    reach: float,
    over: Callable[[], bool],
) -> FloatArray:
    """Waypoints (a, 3), one for each of the first steps, after which the vehicle is nearest to the plan.

    Args:
        vehicle: whose model is asked.
        state: its full state (n,) at the start.
        wanted: (N, 3) x, y, yaw foreseen after each step; later places are tried as waypoints too.
        targets: (a, 2) where the target will be after each step that is driven, a <= N.
        box: lowest and highest (2,) place of a waypoint.
        step: seconds of a step.
        speed: m/s that the vehicle can do.
        heads: whether its yaw is where it goes; otherwise yaw does not count.
        reach: m; an error in yaw counts as of a target no further away than this.
        over: whether to make do with what was tried.
    """
    periods = max(1, round(step / vehicle.control_period))
    altitude = float(vehicle.pose(state)[2])
    chosen = np.empty((len(targets), 3))
    for k, target in enumerate(targets):
        here = vehicle.pose(state)
        goal = _seen(wanted[k], target, reach)

        def within(place: FloatArray) -> FloatArray:
            return np.append(np.clip(place[:2], *box), altitude)

        def miss(
            place: FloatArray,
            state: FloatArray = state,
            goal: FloatArray = goal,
            target: FloatArray = target,
            want: FloatArray = wanted[k],
        ) -> float:
            after = vehicle.pose(vehicle.advance(vehicle.begin(state, place), place, periods))
            apart = after[:2] - want[:2]
            off = _seen(after[[0, 1, 3]], target, reach) - goal if heads else apart
            return float(off @ off + apart @ apart)

        tried = [within(place) for place in wanted[k:]]
        best = min(tried[: 1 if over() else None], key=miss)
        least, full = miss(best), speed * step
        for length in LENGTHS:
            if over():
                break
            for i in range(DIRECTIONS):
                angle = here[3] + 2.0 * math.pi * i / DIRECTIONS
                place = within(here[:2] + length * full * np.array([math.cos(angle), math.sin(angle)]))
                value = miss(place)
                if value < least:
                    best, least = place, value
        span = 0.5
        for _ in range(FINER):
            if over():
                break
            offset = best[:2] - here[:2]
            for turn, stretch in ((span, 1.0), (-span, 1.0), (0.0, 1.0 + span), (0.0, 1.0 - span)):
                c, s = math.cos(0.4 * turn), math.sin(0.4 * turn)
                moved = np.array([c * offset[0] - s * offset[1], s * offset[0] + c * offset[1]])
                place = within(here[:2] + stretch * moved)
                value = miss(place)
                if value < least:
                    best, least = place, value
            span *= 0.5
        chosen[k] = best
        state = vehicle.advance(vehicle.begin(state, best), best, periods)
    return chosen


def _seen(pose: FloatArray, target: FloatArray, reach: float) -> FloatArray:
    """Where (2,) a sensor at x, y, yaw (3,) has a target (2,), no further away than `reach`."""
    gap = target - pose[:2]
    gap = gap * min(1.0, reach / max(float(np.hypot(gap[0], gap[1])), 1e-9))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([c * gap[0] + s * gap[1], c * gap[1] - s * gap[0]])


def timed(
    vehicle: VehicleModel,
    state: FloatArray,
    waypoints: FloatArray,
    step: float,
    start_time: float,
    measure_period: float,
) -> Trajectory:
    """The trajectory that steers for each of the waypoints (a, 3) for `step` seconds, reached or not.

    It ends after the last step. If no other plan comes by then, the robot goes on to the last waypoint.
    """
    period = vehicle.control_period
    periods = max(1, round(step / period))
    every = measure_steps(measure_period, period)
    look = max(1, round(LOOK_S / period))
    steps, poses, done = [0], [vehicle.pose(state)], 0
    measured_steps, measured = [0], [vehicle.pose(state)]
    for k, waypoint in enumerate(waypoints):
        state = vehicle.begin(state, waypoint)
        while done < (k + 1) * periods:
            stride = min(look - done % look, every - done % every, (k + 1) * periods - done)
            state = vehicle.advance(state, waypoint, stride)
            done += stride
            last = done == len(waypoints) * periods
            if done % every == 0 and not last:
                measured_steps.append(done)
                measured.append(vehicle.pose(state))
            if done % look == 0 and not last:
                steps.append(done)
                poses.append(vehicle.pose(state))
    thin = max(1, math.ceil(len(steps) / (SAMPLES - 1)))
    return Trajectory(
        waypoint=waypoints[-1].copy(),
        start_time=start_time,
        end_time=start_time + done * period,
        measure_times=start_time + np.array(measured_steps) * period,
        measure_poses=np.stack(measured),
        times=start_time + np.append(steps[::thin], done) * period,
        poses=np.vstack([np.stack(poses[::thin]), vehicle.pose(state)]),
        end_state=np.array(state),
        control_cost=0.0,
        route=waypoints.copy(),
        route_times=start_time + periods * period * np.arange(len(waypoints), dtype=np.float64),
    )
