"""Planner `mpc`: model predictive control that searches for a moving target and then keeps it in view.

Source: Liu & Hedrick, "Model predictive control-based target search and tracking using autonomous mobile
robot with limited sensing domain", 2017. What differs here, and why:

- What is driven is the vehicle model's own way through the places found, not the controls themselves.
- B u of the target's motion (2) is estimated from one plan to the next, as a planner sees places only.
- The better of the solver's plans and of driving straight to the target is taken, all rolled out by (1):
  the problem is not convex, and a deadline may end the solver early.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray, Fraction, NonNegative, Positive
from estimator.sensor import SensorModel
from estimator.sensors.field_of_view import FieldOfView
from planner.budget import affordable, limited, returning, truncated, way_to
from planner.deadline import Deadline
from planner.irrt.kinematics import FORWARD, Kinematics, identified
from planner.irrt.targets import targets_of
from planner.maasi.maasi import crowded, unplannable
from planner.mpc.model import Domain, Foreseen, Limits, Task, rolled_out, straight
from planner.mpc.nlp import Program
from planner.mpc.part import begun
from planner.plan import Plan, PlannerSetup, PlanProblem, Trajectory
from planner.separation import keeps_apart
from planner.vehicles.route import routed

RESERVE_S = 2e-3  # kept from the deadline
ROUTE_S = 1e-3  # and this for each second of the way that is predicted in full
JUMP_M = 5.0  # a target that moved further than this and its uncertainty is another


class MpcConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Horizon, weights, the robot's limits and the sensing domain."""

    horizon: Annotated[int, Meta(ge=2, le=100)] = 10  # N, steps
    step_s: Positive = 1.0  # Delta t
    apply: Count = 1  # steps that are driven before the next plan
    certainty: NonNegative = 1.0  # w_1, of the covariance's trace
    distance: NonNegative = 0.01  # w_2, of the squared distance to the target
    acceleration_m_s2: Positive = 1.0  # the robot's
    braking_m_s2: Positive = 3.0
    turn_rate_deg_s: Positive = 45.0  # at most, if the vehicle can
    drift: NonNegative = 0.1  # Q: the target's random walk after a second, per axis, m / s^(1/2)
    velocity_m_s: list[float] | None = None  # the target's at first, east and north; default: standing
    velocity_gain: Fraction = 0.3  # how much of a newly seen velocity is believed
    alpha_1: Positive | None = None  # of (7), 1/m^2; default: from the sensor's range
    alpha_2: Positive | None = None  # of (7); default: the sensor's, or 10


@dataclass(slots=True)
class _Memory:
    """Of one robot."""

    kinematics: Kinematics
    one: Program
    two: Program
    velocity: FloatArray
    time: float = math.nan
    place: FloatArray = field(default_factory=lambda: np.zeros(2))
    controls: FloatArray | None = None


class Mpc:
    """Planner: the two-step solution of Liu & Hedrick (2017), section III.C, in a receding horizon.

    Raises:
        ValueError: if CasADi is not installed, naming the extra, or a key is wrong, naming it.
    """

    Config: ClassVar[type[MpcConfig]] = MpcConfig
    deadline: Callable[[float], Deadline] = Deadline  # tests give it another clock

    def __init__(self, config: MpcConfig, setup: PlannerSetup) -> None:
        self.config, self.setup = config, setup
        velocity = np.zeros(2) if config.velocity_m_s is None else np.array(config.velocity_m_s)
        if velocity.shape != (2,) or not np.isfinite(velocity).all():
            raise ValueError(f"velocity_m_s: expected 2 finite numbers, got {config.velocity_m_s}")
        made: dict[tuple[Domain, Limits], tuple[Program, Program]] = {}
        self._memories: dict[str, _Memory] = {}
        area = setup.area
        pose = np.zeros(4)
        pose[: area.dimension] = 0.5 * (area.low + area.high)
        for robot, vehicle in setup.vehicles.items():
            if robot not in setup.sensors:
                continue
            known = next((m for r, m in self._memories.items() if setup.vehicles[r] is vehicle), None)
            side = max(0.2 * float((area.high - area.low).max()), 1.0)
            kinematics = known.kinematics if known else identified(vehicle, vehicle.initial_state(pose), side)
            key = (domain_of(setup.sensors[robot], config, kinematics.heads), self._limits(kinematics))
            if key not in made:
                made[key] = (
                    Program(config.horizon, *key, angular=False),
                    Program(config.horizon, *key, angular=True),
                )
            self._memories[robot] = _Memory(kinematics, *made[key], velocity.copy())

    def __repr__(self) -> str:
        return f"Mpc({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The first steps of the best plan towards the nearest target; without one, to unexplored places."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s - RESERVE_S)
        if deadline.over():
            return Plan(None, "holds: its deadline was over before a plan was made")
        memory = self._memories[problem.robot]
        targets = targets_of(problem, 1.0)
        if targets.known == 0:
            return self._search(problem, targets.means, targets.weights)
        vehicle = self.setup.vehicles[problem.robot]
        pose = vehicle.pose(problem.state)
        nearest = int(np.argmin(np.linalg.norm(targets.means[:2, : targets.known].T - pose[:2], axis=1)))
        place, covariance = targets.means[:, nearest], targets.covariances[nearest]
        task = self._task(problem, memory, place, covariance)
        best, how = self._solved(memory, task, deadline)
        memory.controls = best.controls
        terms = {
            "objective": best.objective,
            "trace": float(best.covariances[-1, 0] + best.covariances[-1, 2]),
            "distance": float(np.linalg.norm(place[:2] - pose[:2])),
        }
        way, why = self._way(problem, memory, best)
        if way is None:
            return returning(problem, self.setup, why) if limited(problem) else Plan(None, f"holds: {why}")
        return Plan(way, f"{how}, target {terms['distance']:.1f} m away", -best.objective, terms)

    def _task(self, problem: PlanProblem, memory: _Memory, place: FloatArray, spread: FloatArray) -> Task:
        """The problem in numbers; the target's velocity is learnt on the way (5a)."""
        config, vehicle = self.config, self.setup.vehicles[problem.robot]
        n, pose = config.horizon, vehicle.pose(problem.state)
        flown = problem.start_time - memory.time
        jumped = np.linalg.norm(place[:2] - memory.place) > JUMP_M + 3.0 * math.sqrt(np.trace(spread))
        if flown > 0 and not jumped:
            seen = (place[:2] - memory.place) / flown
            memory.velocity = memory.velocity + config.velocity_gain * (seen - memory.velocity)
        if not flown <= 0:  # also at first, when it is not a number
            memory.time, memory.place = problem.start_time, place[:2].copy()
        ahead = config.step_s * np.arange(1, n + 1)[:, None]
        velocity = vehicle.velocity(problem.state)
        speed = float(velocity[0] * math.cos(pose[3]) + velocity[1] * math.sin(pose[3]))
        if not memory.kinematics.heads:
            speed = float(np.linalg.norm(velocity[:2]))
            pose[3] = math.atan2(velocity[1], velocity[0]) if speed > 0.1 else math.atan2(
                place[1] - pose[1], place[0] - pose[0]
            )  # fmt: skip
        q = config.drift**2 * config.step_s
        return Task(
            state=np.array([pose[0], pose[1], pose[3], max(speed, 0.0)]),
            covariance=np.array([spread[0, 0], spread[0, 1], spread[1, 1]]),
            targets=np.ascontiguousarray(place[:2] + ahead * memory.velocity),
            noise=noise_of(self.setup.sensors[problem.robot], problem.area.dimension, memory.one.domain),
            process=np.array([q, 0.0, q]),
            step=config.step_s,
            certainty=config.certainty,
            distance=config.distance,
        )

    def _solved(self, memory: _Memory, task: Task, deadline: Deadline) -> tuple[Foreseen, str]:
        """The best of the straight way, the last plan carried on and the two steps' plans; which it is."""
        domain, limits = memory.one.domain, memory.one.limits
        spare = ROUTE_S * self.config.horizon * self.config.step_s

        def over() -> bool:
            return deadline.left() <= spare

        best = rolled_out(task, straight(task, limits), domain, limits, True)
        how = "goes straight"
        if memory.controls is not None:
            shift = min(self.config.apply, len(memory.controls) - 1)
            carried = np.vstack([memory.controls[shift:], np.repeat(memory.controls[-1:], shift, axis=0)])
            again = rolled_out(task, carried, domain, limits, True)
            if again.objective < best.objective:
                best, how = again, "goes on as planned before"
        ended = "the solver had no time"
        for name, program in (("step one", memory.one), ("step two", memory.two)):
            if over():
                break
            try:
                found, ended = program.solve(task, best, over)
            except RuntimeError as error:  # CasADi's, when the solver itself breaks down
                ended = f"the solver failed: {str(error).splitlines()[0][:80]}"
                continue
            if math.isfinite(found.objective) and found.objective < best.objective:
                best, how = found, f"follows {name}"
        return best, f"{how} ({ended})"

    def _way(self, problem: PlanProblem, memory: _Memory, best: Foreseen) -> tuple[Trajectory | None, str]:
        """The vehicle's way through the places foreseen, as far as it is driven; or why there is none."""
        vehicle = self.setup.vehicles[problem.robot]
        pose = vehicle.pose(problem.state)
        reach = max(0.3 * memory.kinematics.speed * self.config.step_s, 0.1)
        route, last = [], pose[:2]
        for x, y in best.states[1:, :2]:
            if math.hypot(x - last[0], y - last[1]) > 0.7 * reach:
                last = np.array([x, y])
                route.append([x, y, pose[2]])
        if not route:  # it stays, but may turn
            yaw = float(best.states[-1, 2])
            route = [[pose[0] + reach * math.cos(yaw), pose[1] + reach * math.sin(yaw), pose[2]]]
        places = np.clip(
            np.array(route)[:, :2],
            np.minimum(problem.area.low[:2], pose[:2]),
            np.maximum(problem.area.high[:2], pose[:2]),
        )
        way: Trajectory | None = routed(
            vehicle,
            problem.state,
            np.column_stack([places, np.full(len(places), pose[2])]),
            problem.start_time,
            problem.measure_period,
            near=reach,
        )
        if way is not None and not self._clear(problem, way):
            way = way_to(problem, self.setup, problem.state, problem.start_time, np.array(route[-1]))
            if way is None or not self._clear(problem, way):
                return None, "every way towards the target would touch an obstacle"
        return self._allowed(problem, way)

    def _search(self, problem: PlanProblem, places: FloatArray, weights: FloatArray) -> Plan:
        """Straight to where, for its distance, most is unexplored: there is no target to foresee."""
        why = "all is explored and no target is known"
        pose = self.setup.vehicles[problem.robot].pose(problem.state)
        d, scale = problem.area.dimension, float((problem.area.high - problem.area.low).max())
        gaps = np.linalg.norm(places.T - pose[:d], axis=1)
        for cell in np.argsort(-weights / (0.1 * scale + gaps), kind="stable")[:4]:
            goal = pose[:3].copy()
            goal[:2] = places[:2, cell]
            way = way_to(problem, self.setup, problem.state, problem.start_time, goal)
            if way is None or not self._clear(problem, way):
                why = "there is no way to what is unexplored"
                continue
            way, why = self._allowed(problem, way)
            if way is not None:
                return Plan(way, f"searches at ({goal[0]:.1f}, {goal[1]:.1f}), no target is known")
        return returning(problem, self.setup, why) if limited(problem) else Plan(None, f"holds: {why}")

    def _clear(self, problem: PlanProblem, way: Trajectory) -> bool:
        if self.setup.ground is None:
            return True
        places = np.ascontiguousarray(way.poses[:, : problem.area.dimension].T)
        return bool(self.setup.ground.segments_clear(places[:, :-1].copy(), places[:, 1:].copy()).all())

    def _allowed(self, problem: PlanProblem, way: Trajectory | None) -> tuple[Trajectory | None, str]:
        """The part of a way that is driven, if the whole keeps to the budget and apart from others."""
        if way is None or not way.end_time > way.start_time:
            return None, "it is where it should be"
        if not affordable(problem, self.setup, way):
            way = truncated(problem, self.setup, way)
        if way is None:
            return None, "its budget allows no way"
        vehicle = self.setup.vehicles[problem.robot]
        if not keeps_apart(problem, vehicle, way):
            return None, crowded(problem.separation).removeprefix("holds: ")
        return begun(vehicle, problem.state, way, self.config.apply * self.config.step_s), ""

    def _limits(self, kinematics: Kinematics) -> Limits:
        config = self.config
        return Limits(
            slowest=kinematics.speed if kinematics.mode == FORWARD else 0.0,
            fastest=kinematics.speed,
            braking=-config.braking_m_s2,
            accelerating=config.acceleration_m_s2,
            turn_rate=min(math.radians(config.turn_rate_deg_s), kinematics.turn_rate),
        )


def domain_of(sensor: SensorModel, config: MpcConfig, heads: bool) -> Domain:
    """(7) of a sensor's field of view: its own numbers if it is a smooth sector, else of like size.

    A robot whose yaw is not its direction of travel is taken to see all around.
    """
    inner: object = sensor
    while hasattr(inner, "sensor"):
        inner = inner.sensor
    view = getattr(inner, "field", None)
    gain, alpha_1, alpha_2, opening = 1.0, 0.01, 10.0, 2.0 * math.pi
    if isinstance(view, FieldOfView):
        gain = view.gain
        if view.shape == "smooth_sector":
            alpha_1, alpha_2, opening = (float(x) for x in view.size)
        elif view.shape == "sector":
            alpha_1, opening = float(view.size[1]) ** -2, float(view.size[2])
        else:
            alpha_1 = float(np.abs(view.size[:2]).max()) ** -2
    around = not heads or opening >= 2.0 * math.pi - 1e-9
    edge = -math.inf if around else math.cos(0.5 * opening)
    return Domain(gain, config.alpha_1 or alpha_1, config.alpha_2 or alpha_2, edge)


def noise_of(sensor: SensorModel, dimension: int, domain: Domain) -> FloatArray:
    """R (3,) in m^2 of the places that a sensor gives, of a target half its range ahead."""
    ahead = np.zeros((dimension, 1))
    ahead[0] = 0.5 / math.sqrt(domain.alpha_1)
    spread = np.eye(dimension)
    if hasattr(sensor, "measure"):
        measured = np.asarray(sensor.measure(ahead, np.zeros(4)))
        spread = sensor.location_covariance(measured, np.zeros(4))[0]
    r = np.array([spread[0, 0], 0.0, spread[1, 1]])
    return np.maximum(np.where(np.isfinite(r), r, 1.0), [1e-6, 0.0, 1e-6])
