"""Planner `mpc`: model predictive control that searches for a moving target and then keeps it in view.

Source: Liu & Hedrick, "Model predictive control-based target search and tracking using autonomous mobile
robot with limited sensing domain", 2017. What differs here, and why:

- The second term of J is the distance of the target from the place deepest inside the sensing domain,
  `Domain.middle`, not from the robot: one that drives up to a target has it beside or behind it next.
- While the estimate is wider than the sensor sees at once, places all over it are looked at one after another
  (`suspects`): the Kalman filter learns nothing from looking in vain.
- What is driven are waypoints that bring the vehicle's own model to where the plan has it (`way`).
- B u of the target's motion (2) is the filter's velocity; if it has none, it is learnt from plan to plan.
- The best of the solver's plans, the last plan and driving straight is taken, all rolled out by (1): the
  problem is not convex, and a deadline may end the solver early.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from estimator.arrays import Count, FloatArray, Fraction, NonNegative, Positive
from planner.budget import way_to
from planner.deadline import Deadline, Reserve
from planner.irrt.kinematics import Kinematics, identified
from planner.irrt.targets import Targets, targets_of
from planner.maasi.maasi import unplannable
from planner.mpc.model import Domain, Foreseen, Limits, Task, rolled_out, straight
from planner.mpc.nlp import Program
from planner.mpc.pursuit import Pursuit
from planner.mpc.search import allowed, held, is_clear, searching
from planner.mpc.sensing import acceleration_of, domain_of, limits_of, noise_of, turning_of
from planner.mpc.way import steered, timed
from planner.plan import Plan, PlannerSetup, PlanProblem, Trajectory

RESERVE_S = 2e-3  # kept from the deadline
WAY_S = 4e-3  # that finding waypoints may take, before it was measured
LEAST_TURN = 0.02  # rad/s, of a vehicle that seems not to turn at all
AROUND_S = 4e-3  # and a way around obstacles
ASKED_S = 1e-2  # that the solver may go on without asking for the time, before that was measured


class MpcConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Horizon, weights, the robot's limits and the sensing domain."""

    horizon: Annotated[int, Meta(ge=2, le=100)] = 10  # N, steps
    step_s: Positive = 1.0  # Delta t
    apply: Count = 1  # steps that are driven before the next plan
    certainty: NonNegative = 1.0  # w_1, of the covariance's trace
    distance: NonNegative = 0.1  # w_2, of the squared distance to the standoff
    standoff_m: NonNegative | None = None  # kept from the target; default: deepest inside the field of view
    acceleration_m_s2: Positive | None = None  # the robot's; default: its vehicle's
    braking_m_s2: Positive | None = None  # default: as it accelerates
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
    noise: FloatArray  # (3,)
    pursuit: Pursuit
    controls: FloatArray | None = None
    way: Trajectory | None = None


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
        self._finish, self._around = Reserve(WAY_S, yields=True), Reserve(AROUND_S)
        self._asking = Reserve(ASKED_S)
        made: dict[tuple[Domain, Limits], tuple[Program, Program]] = {}
        self._memories: dict[str, _Memory] = {}
        area, n = setup.area, config.horizon
        pose = np.zeros(4)
        pose[: area.dimension] = 0.5 * (area.low + area.high)
        for robot, vehicle in setup.vehicles.items():
            if robot not in setup.sensors:
                continue
            known = next((m for r, m in self._memories.items() if setup.vehicles[r] is vehicle), None)
            side = max(0.2 * float((area.high - area.low).max()), 1.0)
            moves = known.kinematics if known else identified(vehicle, vehicle.initial_state(pose), side)
            sensor, turning = setup.sensors[robot], math.radians(config.turn_rate_deg_s)
            if moves.heads:
                turning = min(turning, max(turning_of(vehicle, pose), LEAST_TURN))
            domain = domain_of(sensor, moves.heads, config.alpha_1, config.alpha_2)
            faster = config.acceleration_m_s2 or acceleration_of(vehicle)
            key = domain, limits_of(moves, config.braking_m_s2 or faster, faster, turning)
            if key not in made:
                made[key] = Program(n, *key, angular=False), Program(n, *key, angular=True)
            noise = noise_of(sensor, area.dimension, domain)
            self._memories[robot] = _Memory(moves, *made[key], noise, Pursuit(velocity.copy()))

    def __repr__(self) -> str:
        return f"Mpc({self.config!r})"

    def plan(self, problem: PlanProblem) -> Plan:
        """The first steps of the best plan towards the target; without one, to unexplored places."""
        awkward = unplannable(problem, self.setup)
        if awkward:
            return Plan(None, awkward)
        deadline = self.deadline(problem.deadline_s - RESERVE_S)
        if deadline.over():
            return Plan(None, "holds: its deadline was over before a plan was made")
        memory = self._memories[problem.robot]
        if "rehearsal" in problem.context:  # nothing of it is kept
            memory = replace(memory, pursuit=Pursuit(memory.pursuit.velocity.copy()))
        targets = targets_of(problem, 1.0)
        driven = self.config.apply * self.config.step_s
        if targets.known == 0:
            places = targets.means, targets.weights
            return searching(problem, self.setup, *places, driven, deadline, self._around)
        task, searches = self._task(problem, memory, targets)
        best, how = self._solved(memory, task, deadline)
        memory.controls = best.controls
        terms = {
            "objective": best.objective,
            "trace": float(best.covariances[-1, 0] + best.covariances[-1, 2]),
            "distance": float(np.linalg.norm(task.targets[0] - task.state[:2])),
        }
        with self._finish.measured(deadline):
            way, why = self._way(problem, memory, task, best, deadline)
        memory.way = way
        if way is None:
            return held(problem, self.setup, why)
        x, y = task.targets[0]
        doing = "searches" if searches else "follows a target"
        doing += f" at ({x:.1f}, {y:.1f}), {terms['distance']:.1f} m away"
        return Plan(way, f"{doing}: {how}", -best.objective, terms)

    def _task(self, problem: PlanProblem, memory: _Memory, targets: Targets) -> tuple[Task, bool]:
        """The problem in numbers, and whether the target is being searched for."""
        config, vehicle = self.config, self.setup.vehicles[problem.robot]
        n, pose, pursuit = config.horizon, vehicle.pose(problem.state), memory.pursuit
        looks = None if memory.way is None else (memory.way.measure_times, memory.way.measure_poses)
        place, spread = pursuit.updated(problem, targets, pose, config.velocity_gain, looks)
        memory.way = None
        velocity = vehicle.velocity(problem.state)
        speed = float(velocity[0] * math.cos(pose[3]) + velocity[1] * math.sin(pose[3]))
        if not memory.kinematics.heads:
            speed = float(np.linalg.norm(velocity[:2]))
            way = velocity[:2] if speed > 0.1 else place - pose[:2]
            pose[3] = math.atan2(way[1], way[0])
        sensor, domain, limits = self.setup.sensors[problem.robot], memory.one.domain, memory.one.limits
        seconds = config.apply * config.step_s, config.horizon * config.step_s
        aim, fastest = pursuit.aim(problem, sensor, domain, limits, place, spread, pose, seconds)
        q = config.drift**2 * config.step_s
        ahead = config.step_s * np.arange(1, n + 1)[:, None]
        task = Task(
            state=np.array([pose[0], pose[1], pose[3], max(speed, 0.0)]),
            covariance=np.array([spread[0, 0], spread[0, 1], spread[1, 1]]),
            targets=np.ascontiguousarray(aim + ahead * pursuit.velocity),
            noise=memory.noise,
            process=np.array([q, 0.0, q]),
            step=config.step_s,
            certainty=config.certainty,
            distance=config.distance,
            standoff=memory.one.domain.middle[0] if config.standoff_m is None else config.standoff_m,
            fastest=fastest,
        )
        return task, aim is not place

    def _solved(self, memory: _Memory, task: Task, deadline: Deadline) -> tuple[Foreseen, str]:
        """The best of the straight way, the last plan carried on and the two steps' plans; which it is."""
        domain, limits = memory.one.domain, memory.one.limits

        solving = deadline.less(self._finish.kept(deadline))

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
            if not self._asking.fits(solving):
                break
            try:
                with self._asking.watched(solving) as over:
                    found, ended = program.solve(task, best, over)
            except RuntimeError as error:  # CasADi's, when the solver itself breaks down
                ended = f"the solver failed: {str(error).splitlines()[0][:80]}"
                continue
            if math.isfinite(found.objective) and found.objective < best.objective:
                best, how = found, f"takes {name}"
        return best, f"{how} ({ended})"

    def _way(
        self, problem: PlanProblem, memory: _Memory, task: Task, best: Foreseen, deadline: Deadline
    ) -> tuple[Trajectory | None, str]:
        """The vehicle's way along the plan, as far as it is driven; or why there is none."""
        config, vehicle, moves = self.config, self.setup.vehicles[problem.robot], memory.kinematics
        driven = min(config.apply, config.horizon)
        low = np.minimum(problem.area.low[:2], task.state[:2])
        high = np.maximum(problem.area.high[:2], task.state[:2])
        wanted = best.states[1:, :3].copy()
        wanted[:, :2] = np.clip(wanted[:, :2], low, high)
        points = steered(
            vehicle,
            problem.state,
            wanted,
            task.targets[:driven],
            box=(low, high),
            step=config.step_s,
            speed=moves.speed,
            heads=moves.heads,
            reach=memory.one.domain.reach,
            over=deadline.over,
        )
        start, period = problem.start_time, problem.measure_period
        way = timed(vehicle, problem.state, points, config.step_s, start, period)
        if not is_clear(problem, self.setup, way):
            goal = np.array([*wanted[-1, :2], vehicle.pose(problem.state)[2]])
            if not self._around.fits(deadline):
                return None, "there was no time to find a way around obstacles"
            with self._around.measured(deadline):
                around = way_to(problem, self.setup, problem.state, start, goal, deadline.over)
            if around is None or not is_clear(problem, self.setup, around):
                return None, "every way towards the target would touch an obstacle"
            way = around
        return allowed(problem, self.setup, way, driven * config.step_s)
