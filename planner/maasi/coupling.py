"""How the ways of robots that plan together act on each other, pair by pair: exploration (32), separation."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import kernel
from planner.maasi.coverage import explore
from planner.maasi.outlook import Outlook, candidate_looks
from planner.plan import Commitment, PlannerSetup, PlanProblem
from planner.separation import SAME_PLACE, clearances

NOT_YET = -1  # in a joint index: this robot has not chosen


@dataclass(frozen=True, slots=True)
class Coupling:
    """Pairwise factors of A robots with up to w candidates each."""

    views: tuple[Outlook, ...]
    left: tuple[
        FloatArray, ...
    ]  # per robot a: (A, w, n_a), what candidate w of robot b leaves at a's corners
    kept: BoolArray  # (A, A, w, w) whether candidates of a and b keep the separation

    def exploration(self, a: int, joint: IntArray) -> FloatArray:
        """E^a (j,), (31), for joint indices (j, A)."""
        view = self.views[a]
        offsets = view.predictions.offsets << view.corners.shape[0]
        out = np.zeros(len(joint))
        _exploration(a, np.ascontiguousarray(joint), offsets, view.shares, self.left[a], out)
        return out

    def apart(self, joint: IntArray) -> BoolArray:
        """Whether all robots that have chosen keep the separation, (j,) for joint indices (j, A)."""
        keep = np.ones(len(joint), dtype=np.bool_)
        for a in range(joint.shape[1]):
            for b in range(a + 1, joint.shape[1]):
                pair = self.kept[a, b, joint[:, a], joint[:, b]]
                keep &= pair | (joint[:, a] == NOT_YET) | (joint[:, b] == NOT_YET)
        return keep


def couple(
    problems: list[PlanProblem],
    setup: PlannerSetup,
    views: list[Outlook],
    over: Callable[[], bool] = bool,
) -> Coupling | None:
    """All pairwise factors of the robots' outlooks, in the order of their problems; None if time was up."""
    robots, most = len(views), max(view.steps.size for view in views)
    ways = [_ways(problem, setup, view) for problem, view in zip(problems, views, strict=True)]
    left = tuple(np.ones((robots, most, view.shares.size)) for view in views)
    kept = np.ones((robots, robots, most, most), dtype=np.bool_)
    for a, view in enumerate(views):
        order = np.argsort(view.times, kind="stable")
        times, corners = view.times[order], view.corners[:, order]
        for b in range(robots):
            if a == b:
                continue
            sensor = setup.sensors[problems[b].robot]
            for w, way in enumerate(ways[b]):
                if over():
                    return None
                moving = candidate_looks(views[b].predictions, views[b].start_time, w)
                looks = replace(
                    moving, stand_time=way.times[-1], stand_pose=way.poses[-1], period=way.measure_period
                )
                factor = np.ones(times.size)
                explore(sensor, looks, times, corners, factor)
                left[a][b, w, order] = factor
            if problems[a].separation > 0:
                kept[a, b] = _kept(problems[a], setup, view, ways[b], most)
    return Coupling(tuple(views), left, kept & kept.transpose(1, 0, 3, 2))


def _ways(problem: PlanProblem, setup: PlannerSetup, view: Outlook) -> list[Commitment]:
    """Each candidate's way as if it were committed: samples, the end, then standing."""
    way, vehicle = view.way, setup.vehicles[problem.robot]
    ends = view.end_times
    committed = []
    for w in range(way.steps.size):
        rows = slice(way.offsets[w], way.offsets[w + 1])
        committed.append(
            Commitment(
                robot=problem.robot,
                version=0,
                measure_times=np.zeros(0),
                measure_poses=np.zeros((0, 4)),
                times=np.append(problem.start_time + way.measure_times[rows], ends[w]),
                poses=np.vstack([way.measure_poses[rows], vehicle.pose(way.end_states[w])]),
                measure_period=problem.measure_period,
            )
        )
    return committed


def _kept(
    problem: PlanProblem, setup: PlannerSetup, view: Outlook, others: list[Commitment], most: int
) -> BoolArray:
    """(w, w) whether the candidates of one robot keep its separation from those of another."""
    way, vehicle = view.way, setup.vehicles[problem.robot]
    ends = np.array([vehicle.pose(state)[:3] for state in way.end_states])
    arrivals = view.end_times - view.start_time
    here = vehicle.pose(problem.state)[:3]
    kept = np.ones((most, most), dtype=np.bool_)
    for w, other in enumerate(others):
        least = clearances(
            problem.start_time, way.offsets, way.measure_times, way.measure_poses, arrivals, ends, other
        )
        now = float(np.linalg.norm(here - other.poses[0, :3]))
        kept[: least.size, w] = least >= min(problem.separation, now) - SAME_PLACE
    return kept


@kernel
def _exploration(
    a: int, joint: IntArray, offsets: IntArray, shares: FloatArray, left: FloatArray, out: FloatArray
) -> None:
    for j in range(joint.shape[0]):
        if joint[j, a] < 0:
            continue
        for i in range(offsets[joint[j, a]], offsets[joint[j, a] + 1]):
            share = shares[i]
            for b in range(joint.shape[1]):
                if b != a and joint[j, b] >= 0:
                    share *= left[b, joint[j, b], i]
            out[j] += share
