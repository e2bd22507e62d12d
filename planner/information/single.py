"""Planner `mutual_information`: one robot maximises what the team's next measurements say of the targets.

Dames & Kumar 2015 (see `entropy`). Each robot optimises its own action given the poses at which the others
have committed to measure, which is one step of the paper's coordinate descent over robots; the next robot's
plan is the next step. It goes on to its first poses only (1/T of the way) and plans again, (III-B).

For one robot, modes 0 to 3 are the same: the best of all scales is the best of the scales' best.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.metrics.information import is_settled
from planner.budget import NEAR_M, affordable, limited, returning, truncated
from planner.commitments import looks, usable
from planner.deadline import Deadline
from planner.information.actions import ActionSet, Lattice, Scales, action_sets, looks_along, part
from planner.information.belief import believed, clutter_rate
from planner.information.config import InformationConfig
from planner.information.gains import Fixed, Options, information, nearest_first, options
from planner.maasi.maasi import crowded, unplannable
from planner.plan import Commitment, Intensity, Plan, PlannerSetup, PlanProblem, Trajectory
from planner.separation import keeps_apart
from planner.vehicles.route import routed

LEAST = 1e-9  # nats: less is no reason to go anywhere
LATTICE = 40  # places along the longest side
TRIES = 40  # actions whose ways are looked at
WAY_S = 1e-3  # what looking at a way may take
MODES_BY_SCALE = (1, 3, 5)  # one length scale for all robots
RANDOM = (4, 5)


@dataclass(frozen=True, slots=True)
class Reach:
    """What one robot could do at one length scale."""

    actions: ActionSet
    options: Options


@dataclass(frozen=True, slots=True)
class Chosen:
    """Actions of one robot in the order in which to try them, with the team's information by each."""

    reaches: list[Reach]
    order: list[tuple[int, int]]  # length scale and action
    values: list[float]  # nats
    without: float  # of what the others have committed to alone
    error: float  # by which a value may be off
    note: str = ""  # if time ran out


class MutualInformation:
    """Planner: the action whose measurements, with those of the others, say most of the targets."""

    Config: ClassVar[type[InformationConfig]] = InformationConfig

    def __init__(self, config: InformationConfig, setup: PlannerSetup) -> None:
        self.config = config
        self.setup = setup
        longest = float((setup.area.high - setup.area.low).max())
        self._scales = Scales(
            config.first_scale_m or longest / 8, config.growth, config.scales, config.steps, config.spread
        )
        spacing = config.lattice_m or longest / LATTICE
        self._lattice = None if setup.ground is None else Lattice(setup.area, setup.ground, spacing)
        self._turns: dict[int, bool] = {}
        self._thinned: tuple[Intensity, FloatArray, FloatArray] | None = None  # for robots that plan together

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The way to the first of the best action's poses; a hold with the reason where there is none."""
        if np.isnan(problem.deadline_s):
            return Plan(None, "holds: its deadline is not a number")
        deadline = Deadline(problem.deadline_s)
        awkward, points, weights = self.prepared(problem)
        if awkward is not None:
            return awkward
        fixed, neglected = self.committed(problem, points, weights, self.config.steps)
        reaches = list(self.reach(problem, points, weights, deadline))
        if not reaches:
            return self._nowhere(problem, deadline)
        chosen = self._ranked(problem, reaches, fixed, neglected, deadline)
        return self.followed(problem, chosen, deadline)

    # What both planners need

    def prepared(self, problem: PlanProblem) -> tuple[Plan | None, FloatArray, FloatArray]:
        """A plan if nothing is to be looked for; else the points and weights of what is."""
        config, d = self.config, problem.area.dimension
        none = np.zeros((d, 0)), np.zeros(0)
        reason = unplannable(problem, self.setup)
        if reason:
            return Plan(None, reason), *none
        believed_of = problem.intensity
        if config.settled is not None and believed_of is not None:
            whole = np.isfinite(believed_of.points).all() and np.isfinite(believed_of.weights).all()
            if whole and (believed_of.weights >= 0.0).all():
                points, weights = believed_of.points, believed_of.weights
                if weights.size and is_settled(points, weights, config.settled_cell_m, config.settled):
                    return returning(problem, self.setup, "the search is over, targets are known"), *none
        if believed_of is not None and self._thinned is not None and self._thinned[0] is believed_of:
            return None, *self._thinned[1:]
        points, weights = believed(problem, config.points, config.cell_m, config.expected_targets)
        if weights.size == 0:
            return returning(problem, self.setup, "no target is believed to be anywhere"), *none
        if believed_of is not None:
            self._thinned = believed_of, points, weights
        return None, points, weights

    def committed(
        self,
        problem: PlanProblem,
        points: FloatArray,
        weights: FloatArray,
        own: int,
        planning: tuple[str, ...] = (),
    ) -> tuple[Fixed, float]:
        """The others' events, and a bound in nats of what those left out could change.

        Args:
            problem: of one of the robots that plan.
            points, weights: of the intensity.
            own: robot-steps that are yet to be decided; with these, `exact_steps` must not be exceeded.
            planning: robots that do not count as others.
        """
        detection, clutter = self.events(problem, points, planning)
        here = self.setup.vehicles[problem.robot].pose(problem.state)[: len(points)]
        room = max(0, self.config.exact_steps - own)
        return nearest(detection, points, weights, clutter, here, room, self.config.taylor_terms)

    def events(
        self, problem: PlanProblem, points: FloatArray, planning: tuple[str, ...] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """p_D (k, n) and mu (k,) of what the other robots, but for `planning`, have committed to."""
        rows, rates = [np.zeros((0, points.shape[1]))], []
        for other in problem.others:
            skip = other.robot in (problem.robot, *planning) or other.robot not in self.setup.sensors
            if skip or not usable(other):
                continue
            sensor = self.setup.sensors[other.robot]
            poses = team_poses(other, problem.start_time, self.config.steps)
            detection = sensor.detection(points, poses)
            seen = (detection > 0.0).any(axis=1)
            rows.append(detection[seen])
            rates += [clutter_rate(sensor)] * int(seen.sum())
        return np.vstack(rows), np.array(rates)

    def reach(
        self, problem: PlanProblem, points: FloatArray, weights: FloatArray, deadline: Deadline
    ) -> Iterator[Reach]:
        """The robot's actions at each length scale, until the deadline."""
        robot = problem.robot
        vehicle, sensor = self.setup.vehicles[robot], self.setup.sensors[robot]
        if id(vehicle) not in self._turns:
            self._turns[id(vehicle)] = looks_along(vehicle)
        steps = self.config.steps
        clutter = np.full(steps, clutter_rate(sensor))
        sets = action_sets(
            vehicle.pose(problem.state),
            problem.area,
            self._scales,
            turns=self._turns[id(vehicle)],
            ground=self.setup.ground,
            lattice=self._lattice,
        )
        if deadline.over():
            return
        before = deadline.left()
        for actions in sets:
            detection = sensor.detection(points, actions.poses.reshape(-1, 4)).reshape(
                -1, steps, weights.size
            )
            yield Reach(actions, options(detection, weights, clutter, self.config.taylor_terms))
            left, spent = deadline.left(), before - deadline.left()  # NaN without a deadline
            if left < WAY_S + 1.5 * spent:
                return
            before = left

    def followed(self, problem: PlanProblem, chosen: Chosen, deadline: Deadline) -> Plan:
        """The plan of the first action whose way is free and affordable."""
        pointless = not chosen.order or max(chosen.values) - chosen.without <= LEAST
        if pointless and self.config.mode not in RANDOM:
            return returning(problem, self.setup, "nothing is to be learnt at any place within its scales")
        too_dear = False
        for (scale, index), value in list(zip(chosen.order, chosen.values, strict=True))[:TRIES]:
            if deadline.over():
                return Plan(None, "holds: its deadline passed before a free way was found")
            actions = chosen.reaches[scale].actions
            way = self.way(problem, actions, index)
            if way is None or not keeps_apart(problem, self.setup.vehicles[problem.robot], way):
                continue
            if not affordable(problem, self.setup, way):
                too_dear = True
                continue
            terms = {
                "information": value - chosen.without,
                "team": value,
                "error": chosen.error,
                "length": actions.length,
            }
            place = ", ".join(f"{x:.1f}" for x in actions.corners[index][:, -1])
            reason = f"{value - chosen.without:.3g} nats on {actions.length:.1f} m to ({place}){chosen.note}"
            return Plan(way, reason, value - chosen.without, terms)
        if too_dear:
            return self._truncated(problem, chosen)
        return Plan(None, crowded(problem.separation))

    def way(self, problem: PlanProblem, actions: ActionSet, index: int) -> Trajectory | None:
        """The trajectory to the pose after which to plan again; None if the robot is there already."""
        config, vehicle = self.config, self.setup.vehicles[problem.robot]
        share = min(1.0, config.replan_after / config.steps)
        corners = part(actions.corners[index], share)[:, 1:]
        state, start, period = problem.state, problem.start_time, problem.measure_period
        route = np.tile(vehicle.pose(state)[:3], (corners.shape[1], 1))
        route[:, : len(corners)] = corners.T
        if len(route) == 1:
            way = vehicle.trajectory(state, route[0], start, period)
        else:
            way = routed(vehicle, state, route, start, period, near=NEAR_M)
        return way if way.end_time > way.start_time else None

    def _truncated(self, problem: PlanProblem, chosen: Chosen) -> Plan:
        """As much of the best way as the budget allows."""
        scale, index = chosen.order[0]
        way = self.way(problem, chosen.reaches[scale].actions, index)
        some = None if way is None else truncated(problem, self.setup, way)
        if some is None or not keeps_apart(problem, self.setup.vehicles[problem.robot], some):
            return returning(problem, self.setup, "its budget allows no action")
        gain = chosen.values[0] - chosen.without
        return Plan(some, "as far as its budget allows", gain, {"information": gain, "error": chosen.error})

    # One robot's choice

    def _ranked(
        self, problem: PlanProblem, reaches: list[Reach], fixed: Fixed, neglected: float, deadline: Deadline
    ) -> Chosen:
        without, mode = fixed.information, self.config.mode
        if mode in RANDOM:
            return self._random(problem, reaches, fixed, neglected)
        values: list[tuple[float, int, int]] = []
        note = ""
        for scale, reach in enumerate(reaches):
            some = information(fixed, reach.options)
            values += [(float(value), scale, index) for index, value in enumerate(some)]
            if deadline.left() < WAY_S:
                note = ", the best when its time was up"
                break
        values.sort(key=lambda entry: (-entry[0], entry[1], entry[2]))
        order = [(scale, index) for _, scale, index in values]
        error = neglected + fixed.error + _slack(reaches)
        return Chosen(reaches, order, [value for value, _, _ in values], without, error, note)

    def _random(self, problem: PlanProblem, reaches: list[Reach], fixed: Fixed, neglected: float) -> Chosen:
        """Modes 4 and 5: an action at random; of those drawn one per scale, the most informative."""
        rng = np.random.default_rng(problem.seed)
        values = [information(fixed, reach.options) for reach in reaches]
        every = [(s, i) for s, reach in enumerate(reaches) for i in range(reach.options.size)]
        drawn = [every[k] for k in rng.permutation(len(every))]
        if self.config.mode in MODES_BY_SCALE:
            one = {s: (s, i) for s, i in reversed(drawn)}
            best = sorted(one.values(), key=lambda entry: -values[entry[0]][entry[1]])
            drawn = best + [entry for entry in drawn if entry not in best]
        told = [float(values[s][i]) for s, i in drawn]
        return Chosen(reaches, drawn, told, fixed.information, neglected + fixed.error + _slack(reaches))

    def _nowhere(self, problem: PlanProblem, deadline: Deadline) -> Plan:
        if deadline.over():
            return Plan(None, "holds: its deadline passed before it had any action")
        why = "no place at the distance of a length scale is in the area and can be reached"
        return returning(problem, self.setup, why) if limited(problem) else Plan(None, f"holds: {why}")


def _slack(reaches: list[Reach]) -> float:
    """By how much the Taylor terms may mistake an action, in nats."""
    return max(float(reach.options.error.max()) for reach in reaches)


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
    detection: FloatArray,
    points: FloatArray,
    weights: FloatArray,
    clutter: FloatArray,
    here: FloatArray,
    most: int,
    terms: int,
) -> tuple[Fixed, float]:
    """The `most` events whose points are nearest to `here` (d,), and the information of the others (nats).

    What events D left out could change: by the chain rule an action adds at most I[X; D] less, and not more.
    """
    order = nearest_first(detection, points, weights, here)
    kept, left = np.sort(order[:most]), order[most:]
    fixed = Fixed.of(np.ascontiguousarray(detection[kept]), weights, clutter[kept], terms)
    neglected = sum(
        Fixed.of(np.ascontiguousarray(detection[[i]]), weights, clutter[[i]], terms).information for i in left
    )
    return fixed, float(neglected)
