"""What each candidate of one robot promises: the (MA)ASI objective (17)-(22), (27)-(32), term by term.

The predicted exploration function ê is only ever asked for at the poses of planned measurements, where it is
interpolated from the corners of one grid cell. So ê is followed at these corners alone, as a product of what
each measurement before leaves unexplored there; the grid is never copied.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.sensor import SensorModel
from planner.commitments import Looks
from planner.maasi.coverage import BATCH, cell_corners, explore
from planner.maasi.ways import ways
from planner.others import Others
from planner.plan import Commitment, PlannerSetup, PlanProblem, Predictions, VehicleModel
from planner.separation import kept
from planner.vehicles.prediction import finer, measure_steps, measurements_only


@dataclass(frozen=True, slots=True)
class Outlook:
    """w candidates of one robot with r planned measurements in all, each with 2^d corners around it."""

    start_time: float
    control_period: float
    predictions: Predictions  # times and poses of the measurements only
    control: FloatArray  # (w,) C, (28)
    refinement: FloatArray  # (w,) T, (29)
    candidate: IntArray  # (r,) which candidate a measurement belongs to
    times: FloatArray  # (r * 2^d,) team time at which each corner is looked at
    corners: FloatArray  # (d, r * 2^d) grid points around the measurement poses
    shares: FloatArray  # (r * 2^d,) interpolation weight times ê after own and committed measurements
    way: Predictions  # with samples of the ways between the measurements, if separation asks for them
    clearance: FloatArray  # (w,) metres kept from the others' committed ways; infinite if nobody asked
    clear: BoolArray  # (w,) whether that is enough

    @property
    def steps(self) -> IntArray:
        """(w,) control steps K."""
        return self.predictions.steps

    @property
    def end_times(self) -> FloatArray:
        """(w,) team time of arrival."""
        return self.start_time + self.steps.astype(np.float64) * self.control_period

    @property
    def exploration(self) -> FloatArray:
        """(w,) E, (31), with what is known of the others."""
        return self.explored(self.shares)

    def explored(self, shares: FloatArray) -> FloatArray:
        """(w,) the sum of `shares` per candidate."""
        per_look = shares.reshape(-1, 1 << self.corners.shape[0]).sum(axis=1)
        return totals(self.candidate, per_look, self.steps.size)


def totals(index: IntArray, values: FloatArray, size: int) -> FloatArray:
    """(size,) sums of the values (r,) that share an index (r,)."""
    sums = np.zeros(size)
    np.add.at(sums, index, values)
    return sums


def outlook(
    problem: PlanProblem,
    setup: PlannerSetup,
    waypoints: FloatArray,
    others: tuple[Commitment, ...] | Others,
    finely: bool = False,
    over: Callable[[], bool] = bool,
) -> Outlook:
    """Predict the way to every waypoint (w, 3), and all that the objective needs to know of it.

    Args:
        problem: with a finite state.
        setup: the team's models; that of the problem's robot must be there.
        waypoints: candidates.
        others: commitments to condition on.
        finely: sample the ways finely even without a separation to keep.
        over: whether time is up; ways that are not straight are then not looked for any more, nor is what is
            left of the others' measurements looked at.
    """
    vehicle, sensor = setup.vehicles[problem.robot], setup.sensors[problem.robot]
    others = others if isinstance(others, Others) else Others(others, problem)
    every = measure_steps(problem.measure_period, vehicle.control_period)
    apart = problem.separation > 0 and bool(others.commitments)
    closely = apart or finely or setup.ground is not None
    parts = finer(every, vehicle.control_period) if closely else 1
    way = ways(problem, setup, waypoints, every / parts * vehicle.control_period, over)
    predictions = way if parts == 1 else measurements_only(way, parts)
    clearance, clear = np.full(len(waypoints), np.inf), np.ones(len(waypoints), dtype=np.bool_)
    if apart:
        clearance, clear = _clearance(problem, vehicle, way, others)

    poses = predictions.measure_poses
    corners, shares = cell_corners(problem.exploration, poses[:, : problem.exploration.values.ndim])
    times = problem.start_time + np.repeat(predictions.measure_times, 1 << corners.shape[0])
    candidate = np.repeat(np.arange(len(waypoints)), np.diff(predictions.offsets))
    _own_looks(sensor, problem.start_time, predictions, times, corners, shares)
    others_looks(problem, setup, others, times, corners, shares, over)
    return Outlook(
        start_time=problem.start_time,
        control_period=vehicle.control_period,
        predictions=predictions,
        control=predictions.control_costs,
        refinement=_refinement(sensor, problem.clusters, predictions, candidate),
        candidate=candidate,
        times=times,
        corners=corners,
        shares=shares,
        way=way,
        clearance=clearance,
        clear=clear,
    )


def candidate_looks(predictions: Predictions, start_time: float, candidate: int) -> Looks:
    """The measurements on the way to one candidate, without those after it."""
    rows = slice(predictions.offsets[candidate], predictions.offsets[candidate + 1])
    times, poses = start_time + predictions.measure_times[rows], predictions.measure_poses[rows]
    return Looks(times, poses, np.inf, np.zeros(4), 1.0)


def _own_looks(
    sensor: SensorModel,
    start_time: float,
    predictions: Predictions,
    times: FloatArray,
    corners: FloatArray,
    shares: FloatArray,
) -> None:
    """Each candidate's measurements explore what they look at and what its later ones look at, (21)."""
    offsets = predictions.offsets << corners.shape[0]
    for i in range(offsets.size - 1):
        columns = slice(offsets[i], offsets[i + 1])
        way = candidate_looks(predictions, start_time, i)
        explore(sensor, way, times[columns], corners[:, columns], shares[columns])


def others_looks(
    problem: PlanProblem,
    setup: PlannerSetup,
    others: Others,
    times: FloatArray,
    corners: FloatArray,
    shares: FloatArray,
    over: Callable[[], bool] = bool,
) -> None:
    """The others' committed measurements explore too, (32): taken from the shares (n,) in place.

    Args:
        problem, setup: of the robot that plans.
        others: the other robots.
        times: (n,) team time at which each corner is looked at.
        corners: (d, n).
        shares: (n,).
        over: whether time is up.
    """
    known = [i for i, other in enumerate(others.commitments) if other.robot in setup.sensors]
    if not known or times.size == 0:
        return
    order = np.argsort(times, kind="stable")
    ordered, points, left = times[order], corners[:, order], shares[order]
    for i in known:
        if over():
            break
        explore(setup.sensors[others.commitments[i].robot], others.tail(i), ordered, points, left)
    shares[order] = left


def _refinement(
    sensor: SensorModel, clusters: FloatArray, predictions: Predictions, candidate: IntArray
) -> FloatArray:
    """(w,) T, (19), (29): p_D of the cluster centres, summed over the planned measurements."""
    poses = predictions.measure_poses
    seen = np.zeros(len(poses))
    clusters = np.ascontiguousarray(clusters[:, np.isfinite(clusters).all(axis=0)])
    if clusters.shape[1]:
        rows = max(1, BATCH // clusters.shape[1])
        for first in range(0, len(poses), rows):
            some = slice(first, first + rows)
            seen[some] = sensor.detection(clusters, poses[some]).sum(axis=1)
    return totals(candidate, seen, predictions.steps.size)


def _clearance(
    problem: PlanProblem, vehicle: VehicleModel, way: Predictions, others: Others
) -> tuple[FloatArray, BoolArray]:
    """Metres (w,) kept from the others, and whether they are enough."""
    ends = np.array([vehicle.pose(state)[:3] for state in way.end_states]).reshape(-1, 3)
    return kept(
        others.courses,
        problem.start_time,
        problem.separation,
        vehicle.pose(problem.state)[:3],
        way.offsets,
        way.measure_times,
        way.measure_poses,
        way.steps.astype(np.float64) * vehicle.control_period,
        ends,
    )
