"""Events that are decided: the measurements that other robots have committed to make.

Of too many, the nearest are conditioned on. By the chain rule an action adds I[X; D] less, at most, if the
events D that are left out count too, and not more; I[X; D] is at most the sum of what each says alone.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.kernels import kernel
from planner.commitments import heeded, looks
from planner.information.belief import clutter_rate
from planner.information.conditional import conditional_kernel
from planner.information.gains import Fixed, Options
from planner.plan import Commitment, Over, PlannerSetup, PlanProblem, never


@dataclass(frozen=True, slots=True)
class Events:
    """What is decided: p_D (k, n), mu (k,)."""

    detection: FloatArray
    clutter: FloatArray

    def with_action(self, options: Options, index: int) -> "Events":
        """One more robot's action is decided."""
        own = options.detection(index, self.detection.shape[1])
        return Events(np.vstack([self.detection, own]), np.append(self.clutter, options.clutter))

    def only(self, rows: IntArray) -> "Events":
        """Some of them."""
        return Events(np.ascontiguousarray(self.detection[rows]), self.clutter[rows])


def committed(
    problem: PlanProblem,
    setup: PlannerSetup,
    points: FloatArray,
    steps: int,
    planning: tuple[str, ...] = (),
    over: Over = never,
) -> Events:
    """What the other robots have committed to measure that sees any of points (d, n), `steps` poses of each.

    Args:
        planning: robots that do not count as others.
        over: whether time is up: then those after it do not count.
    """
    poses: dict[int, list[FloatArray]] = {}
    sensors = {}
    for other in heeded(problem.others, problem.robot):
        if over():
            break
        if other.robot in planning or other.robot not in setup.sensors:
            continue
        sensor = setup.sensors[other.robot]
        sensors[id(sensor)] = sensor
        poses.setdefault(id(sensor), []).append(team_poses(other, problem.start_time, steps))
    rows, rates = [np.zeros((0, points.shape[1]))], [np.zeros(0)]
    for key, some in poses.items():
        detection = sensors[key].detection(points, np.vstack(some))
        rows.append(detection[(detection > 0.0).any(axis=1)])
        rates.append(np.full(len(rows[-1]), clutter_rate(sensors[key])))
    return Events(np.vstack(rows), np.concatenate(rates))


def team_poses(other: Commitment, start: float, steps: int) -> FloatArray:
    """`steps` poses (k, 4), evenly among those of another robot's measurements to come, the last included."""
    plan = looks(other, start)
    poses = plan.poses
    if np.isfinite(plan.stand_time):
        poses = np.vstack([poses, plan.stand_pose])
    if len(poses) <= steps:
        return np.ascontiguousarray(poses.reshape(-1, 4))
    rows: IntArray = np.round(np.linspace(0, len(poses) - 1, steps + 1)[1:]).astype(np.int64)
    return np.ascontiguousarray(poses[rows])


def nearest(
    events: Events, points: FloatArray, weights: FloatArray, here: FloatArray, most: int, terms: int
) -> tuple[Fixed, float]:
    """The `most` events whose points are nearest to `here` (d,), and a bound on what the rest says (nats)."""
    order = np.arange(events.clutter.size)
    if order.size > most:
        order = nearest_first(events.detection, points, weights, here)
    kept, left = events.only(np.sort(order[:most])), events.only(order[most:])
    fixed = Fixed.of(kept.detection, weights, kept.clutter, terms)
    return fixed, float(most_alone(left.detection, weights, left.clutter, terms).sum())


def nearest_first(detection: FloatArray, points: FloatArray, weights: FloatArray, at: FloatArray) -> IntArray:
    """Numbers of events (k,), that first whose expected detections have their middle nearest to `at` (d,)."""
    middles = (detection * weights) @ points.T / np.maximum((detection @ weights)[:, None], 1e-300)
    return np.argsort(np.linalg.norm(middles - at, axis=1), kind="stable")


@kernel
def most_alone(detection: FloatArray, weights: FloatArray, clutter: FloatArray, terms: int) -> FloatArray:
    """(m,) nats that single events with p_D (m, n) say of the targets, or more by the Taylor terms' error."""
    stated, _low, high = conditional_kernel(detection, weights, clutter, terms)
    for i in range(stated.size):
        seen = clutter[i]
        for x in range(weights.size):
            seen += weights[x] * detection[i, x]
        p, entropy = np.exp(-seen), 0.0
        if 0.0 < p < 1.0:
            entropy = p * seen - (1.0 - p) * np.log1p(-p)
        stated[i] = max(0.0, entropy - stated[i] + high[i])
    return stated
