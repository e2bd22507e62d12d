"""The task information heuristic: what a robot learns by refining a cluster of targets, and in what time.

Source: Ponda et al. (2012), section III.B.1. A robot enters the cluster at the nearest point of a sphere
around its centre, goes from there, one measurement after another, the step that leaves the least mean
A-optimality (the trace of the inverse Fisher information (8), (12), (13)), until that is small enough or
its time is over, and the task's score is what was learnt less the fuel. What is learnt is given here as the
share of each target's uncertainty that is taken away, (tr P - tr P') / (tr P + enough), times the target's
mass, so that it is in expected targets as all other scores are; a look gives p_D times the information of a
measurement.

All entrances to all tasks are computed together: only the places of the targets relative to the robot matter,
so one call of the sensor model serves all. Walls are not seen by it; it is a heuristic.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel, gaussian
from planner.allocation.tasks import Task
from planner.plan import Over, never

ENTRANCES = 8  # directions from which a cluster is entered
LEAST_SPREAD = 1e-3  # metres


@dataclass(frozen=True, slots=True)
class InformationRules:
    """When the greedy path ends, and what it costs."""

    step: float  # metres between two measurements
    period: float  # seconds between them
    margin: float = 5.0  # metres around the cluster at which it is entered
    enough: float = 0.25  # metres of standard deviation per axis at which a target is known well enough
    looks: int = 12  # at most
    fuel: float = 0.0  # per second


@dataclass(frozen=True, slots=True)
class Learnt:
    """Of t tasks and e entrances."""

    score: FloatArray  # (t, e) expected targets, less fuel
    seconds: FloatArray  # (t, e) within the task
    entrances: FloatArray  # (t, e, d) metres
    directions: FloatArray  # (e, d) from the task's middle


def learnt(
    sensor: SensorModel, tasks: list[Task], rules: InformationRules, altitude: float, over: Over = never
) -> Learnt:
    """The heuristic for clusters `tasks` from ENTRANCES directions around them.

    A sensor without a Jacobian is taken to learn all there is at the entrance.

    Args:
        sensor: on a space of the tasks' dimension d.
        tasks: of clusters, with covariances.
        rules: of the path.
        altitude: of the robot in a 2D area, m.
        over: whether time is up: then the paths end sooner, after one look at least.
    """
    d = sensor.dimension
    angles = 2 * np.pi * np.arange(ENTRANCES) / ENTRANCES
    directions = np.zeros((ENTRANCES, d))
    directions[:, 0], directions[:, 1] = np.cos(angles), np.sin(angles)
    t, most = len(tasks), max((task.weights.size for task in tasks), default=0)
    if t == 0:
        return Learnt(
            np.zeros((0, ENTRANCES)), np.zeros((0, ENTRANCES)), np.zeros((0, ENTRANCES, d)), directions
        )
    means, covariances, masses = (
        np.zeros((t, most, d)),
        np.tile(np.eye(d), (t, most, 1, 1)),
        np.zeros((t, most)),
    )
    for i, task in enumerate(tasks):
        m = task.weights.size
        means[i, :m], covariances[i, :m], masses[i, :m] = (
            task.points.T,
            _whole(task.covariances),
            task.weights,
        )
    radii = np.array([task.radius for task in tasks]) + rules.margin
    middles = np.array([task.place for task in tasks])
    entrances = middles[:, None] + radii[:, None, None] * directions
    pairs = t * ENTRANCES
    try:
        gaussian(sensor)
    except ValueError:
        score = np.repeat(masses.sum(axis=1)[:, None], ENTRANCES, axis=1)
        return Learnt(score, np.zeros((t, ENTRANCES)), entrances, directions)
    score, seconds = _greedy(
        sensor,
        entrances.reshape(pairs, d),
        np.repeat(means, ENTRANCES, axis=0),
        np.repeat(covariances, ENTRANCES, axis=0),
        np.repeat(masses, ENTRANCES, axis=0),
        np.repeat(middles, ENTRANCES, axis=0),
        rules,
        altitude,
        over,
    )
    return Learnt(score.reshape(t, -1), seconds.reshape(t, -1), entrances, directions)


def _greedy(
    sensor: SensorModel,
    places: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
    masses: FloatArray,
    middles: FloatArray,
    rules: InformationRules,
    altitude: float,
    over: Over,
) -> tuple[FloatArray, FloatArray]:
    """Scores and seconds (p,) of p greedy paths from `places` (p, d) among targets (p, m)."""
    p, d = places.shape
    before = np.trace(covariances, axis1=2, axis2=3)
    information: FloatArray = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
    shares = masses / np.maximum(masses.sum(axis=1, keepdims=True), 1e-300)
    left = (shares * before).sum(axis=1)  # mean A-optimality, (13)
    enough = d * rules.enough**2
    moves = _moves(d) * rules.step
    seconds, going = np.zeros(p), np.ones(p, dtype=np.bool_)
    for look in range(rules.looks):
        if look and over():
            break
        options = places[:, None] + moves  # (p, k, d)
        gained = _fisher(sensor, options, means, middles, altitude)  # (p, k, m, d, d)
        after: FloatArray = information[:, None] + gained
        traces = _inverse_trace(after)  # (p, k, m)
        cost = (shares[:, None] * traces).sum(axis=2)
        best = np.argmin(cost, axis=1)
        rows = np.arange(p)
        going = going & (cost[rows, best] < left * (1 - 1e-9))
        information = np.where(going[:, None, None, None], after[rows, best], information)
        places = np.where(going[:, None], options[rows, best], places)
        left = np.where(going, cost[rows, best], left)
        seconds += going * rules.period
        going = going & (left > enough)
        if not going.any():
            break
    traces = _inverse_trace(information)
    score = (masses * (before - traces) / (before + enough)).sum(axis=1)
    return score - rules.fuel * seconds, seconds


def _inverse_trace(information: FloatArray) -> FloatArray:
    """The trace of each inverse (..., d, d), bounded where one direction is known next to perfectly."""
    d = information.shape[-1]
    scale = np.trace(information, axis1=-2, axis2=-1)[..., None, None]
    made: FloatArray = np.trace(np.linalg.inv(information + 1e-9 * scale * np.eye(d)), axis1=-2, axis2=-1)
    return made


def _whole(covariances: FloatArray) -> FloatArray:
    """The covariances (m, d, d), of which no direction is known better than to LEAST_SPREAD."""
    values, vectors = np.linalg.eigh(0.5 * (covariances + covariances.transpose(0, 2, 1)))
    values = np.maximum(values, LEAST_SPREAD**2)
    made: FloatArray = np.einsum("mij,mj,mkj->mik", vectors, values, vectors)
    return made


def _moves(d: int) -> FloatArray:
    """Staying, eight ways in the plane and, in 3D, up and down."""
    angles = np.pi / 4 * np.arange(8)
    moves = np.zeros((9 if d == 2 else 11, d))
    moves[1:9, 0], moves[1:9, 1] = np.cos(angles), np.sin(angles)
    if d == 3:
        moves[9, 2], moves[10, 2] = 1.0, -1.0
    return moves


def _fisher(
    sensor: SensorModel, options: FloatArray, means: FloatArray, middles: FloatArray, altitude: float
) -> FloatArray:
    """p_D H^T R^-1 H (p, k, m, d, d) of looks from `options` (p, k, d), facing the middle."""
    p, k, d = options.shape
    m = means.shape[1]
    ahead = middles[:, None] - options
    yaw = np.arctan2(ahead[..., 1], ahead[..., 0])
    turn = np.zeros((p, k, d, d))  # from the world to the robot's frame
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(yaw)
    turn[..., 0, 1], turn[..., 1, 0] = np.sin(yaw), -np.sin(yaw)
    if d == 3:
        turn[..., 2, 2] = 1.0
    relative = means[:, None] - options[:, :, None]  # (p, k, m, d)
    seen = np.einsum("pkij,pkmj->pkmi", turn, relative)
    points = np.ascontiguousarray(seen.reshape(-1, d).T)
    pose = np.array([0.0, 0.0, altitude if d == 2 else 0.0, 0.0])
    model = gaussian(sensor)
    detection = sensor.detection(points, pose[None])[0].reshape(p, k, m)
    jacobian = model.jacobian(points, pose).reshape(p, k, m, -1, d)
    jacobian = np.einsum("pkmsi,pkij->pkmsj", jacobian, turn)
    weighted = np.einsum("st,pkmtj->pkmsj", np.linalg.inv(model.noise), jacobian)
    fisher = np.einsum("pkmsi,pkmsj->pkmij", jacobian, weighted)
    made: FloatArray = detection[..., None, None] * fisher
    return made
