"""The seam between planners and the team: one frozen problem in, one plan out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensor import SensorModel


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Where a robot will go and measure: the answer of a vehicle model to one waypoint."""

    waypoint: FloatArray  # (3,) metres
    start_time: float  # team time, s
    end_time: float  # when it comes within the waypoint's tolerance
    measure_times: FloatArray  # (m,) planned measurement instants, the first at start_time
    measure_poses: FloatArray  # (m, 4)
    times: FloatArray  # (k,) of the samples below
    poses: FloatArray  # (k, 4) samples of the way, start and end among them
    end_state: FloatArray  # (n,) the vehicle's full state at end_time
    control_cost: float  # sum of u^T u over the control steps, (MA)ASI (18)
    route: FloatArray  # (r, 3) waypoints that the vehicle steers for in turn, the last is `waypoint`
    route_times: FloatArray  # (r,) team time from which it steers for each, the first at start_time

    @property
    def end_pose(self) -> FloatArray:
        return np.asarray(self.poses[-1], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Predictions:
    """Trajectories of one vehicle to w waypoints at once; measurements of all lie in flat arrays."""

    waypoints: FloatArray  # (w, 3)
    steps: IntArray  # (w,) control steps K to reach each
    control_costs: FloatArray  # (w,)
    offsets: IntArray  # (w + 1,) waypoint i measures at rows offsets[i]:offsets[i + 1]
    measure_times: FloatArray  # (total,) seconds after the start
    measure_poses: FloatArray  # (total, 4)
    end_states: FloatArray  # (w, n)


class VehicleModel(Protocol):
    """How one kind of vehicle moves. The planner predicts with it, the simulated vehicle runs on it."""

    @property
    def control_period(self) -> float:
        """T_s in seconds."""

    def initial_state(self, pose: FloatArray) -> FloatArray:
        """The vehicle's full state (n,), at rest at pose (4,)."""

    def pose(self, state: FloatArray) -> FloatArray:
        """(4,) pose of a state."""

    def velocity(self, state: FloatArray) -> FloatArray:
        """(3,) velocity in m/s, ENU, of a state."""

    def begin(self, state: FloatArray, waypoint: FloatArray) -> FloatArray:
        """The state with its controller aimed at a new waypoint (3,)."""

    def advance(self, state: FloatArray, waypoint: FloatArray, steps: int) -> FloatArray:
        """The state after `steps` control periods towards the waypoint."""

    def reached(self, state: FloatArray, waypoint: FloatArray) -> bool:
        """Whether the state is within the waypoint's tolerance epsilon."""

    def predict(self, state: FloatArray, waypoints: FloatArray, measure_period: float) -> Predictions:
        """`advance` from `begin` until reached, for every waypoint (w, 3) on its own."""

    def trajectory(
        self, state: FloatArray, waypoint: FloatArray, start_time: float, measure_period: float
    ) -> Trajectory:
        """One waypoint's way in full, with samples for people and for the others to plan around."""


@dataclass(frozen=True, slots=True)
class Commitment:
    """Another robot's committed plan, as far as this robot knows it: its tail, then standing still."""

    robot: str
    version: int
    measure_times: FloatArray  # (m,) team time
    measure_poses: FloatArray  # (m, 4)
    times: FloatArray  # (k,) team time, samples of the way
    poses: FloatArray  # (k, 4)
    measure_period: float
    boot: str = ""  # of the process that committed: versions count anew with each


@dataclass(frozen=True, slots=True)
class Intensity:
    """What the team believes of targets to search for and to follow, whatever filter made it.

    Found targets that stand have left it; those that stay in the filter because they move are clusters here.
    """

    points: FloatArray  # (d, n) that stand for the whole intensity, undetected targets among them
    weights: FloatArray  # (n,) expected targets each
    means: FloatArray  # (d, c) clusters: estimated targets
    covariances: FloatArray  # (c, d, d) m^2
    masses: FloatArray  # (c,) expected targets in each
    velocities: FloatArray | None = None  # (d, c) m/s, 0 where the filter estimates none; None: all stand
    time: float | None = None  # team time of the clusters; None: the problem's start_time

    @staticmethod
    def empty(dimension: int) -> "Intensity":
        """Nothing is believed to be anywhere."""
        d = dimension
        none = np.zeros((d, 0))
        return Intensity(none, np.zeros(0), none, np.zeros((0, d, d)), np.zeros(0))


@dataclass(frozen=True, slots=True)
class Budget:
    """What a robot may still spend. No plan exceeds it, the way back `home` included."""

    distance: float = np.inf  # metres
    time: float = np.inf  # seconds
    home: FloatArray | None = None  # (3,) to which the robot must be able to return
    energy: float = np.inf  # joules, of a vehicle model that knows what it consumes


UNLIMITED = Budget()


@dataclass(frozen=True, slots=True)
class PlanProblem:
    """All that one robot's planner may look at."""

    robot: str
    state: FloatArray  # the vehicle's full state at start_time
    start_time: float  # team time at which the plan will begin
    measure_period: float
    clusters: FloatArray  # (d, c) estimated targets not yet found
    exploration: Exploration
    others: tuple[Commitment, ...]
    area: Area
    separation: float = 0.0  # metres that any two robots keep apart
    intensity: Intensity | None = None  # None: nothing was heard of it yet
    budget: Budget = UNLIMITED
    deadline_s: float = np.inf  # wall time after which the best plan so far is to be returned
    seed: int = 0  # for planners that draw; another for every plan of every robot
    context: Mapping[str, Any] = field(default_factory=dict)  # for some only; "rehearsal": to be forgotten


@dataclass(frozen=True, slots=True)
class Plan:
    """A planner's answer. Without a trajectory the robot holds, and `reason` says why in words."""

    trajectory: Trajectory | None
    reason: str
    objective: float = 0.0
    terms: Mapping[str, float] = field(default_factory=dict)
    task: str = ""  # that it is a plan for, where robots share tasks


class Planner(Protocol):
    """Decides one robot's next trajectory."""

    def plan(self, problem: PlanProblem) -> Plan:
        """The best plan found; never raises for an awkward problem, holds with a reason instead."""


@runtime_checkable
class TeamPlanner(Protocol):
    """Decides several robots' next trajectories at once, in a centre. For comparison in `simulate`."""

    def plan_jointly(self, problems: tuple[PlanProblem, ...]) -> tuple[Plan, ...]:
        """One plan per problem, in their order."""


Over = Callable[[], bool]  # whether time has run out


def never() -> bool:
    """There is always time."""
    return False


class Ground(Protocol):
    """Where robots may be: the area without obstacles (grown by the robot's radius) and keep-out zones.

    Searches for ways ask `over` from time to time, and end when it says so as if there were no way on; near
    places are reached first. What they found is not wrong, it is only less.
    """

    def clear(self, points: FloatArray) -> BoolArray:
        """(n,) whether points (d, n) may be entered."""

    def segments_clear(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """(n,) whether the straight ways from starts (d, n) to ends (d, n) may be taken."""

    def path(self, start: FloatArray, goal: FloatArray, over: Over = never) -> FloatArray | None:
        """The corners (d, k) of a shortest way from start (d,) to goal (d,), with both; None: no way.

        From a start that is not clear there is one only if the ground knows how to leave it; to a goal that
        is not, there is none.
        """

    def paths(self, start: FloatArray, goals: FloatArray, over: Over = never) -> list[FloatArray | None]:
        """`path` from one start to goals (d, n): for all of them little dearer than for one."""

    def distances(
        self, goal: FloatArray, points: FloatArray, over: Over = never, within: float = np.inf
    ) -> FloatArray:
        """(n,) metres of the shortest ways from points (d, n) to goal (d,); infinite where there is none.

        Those of more than `within` metres need not be known: they may be infinite too.
        """


@dataclass(frozen=True, slots=True)
class PlannerSetup:
    """What a planner is made with: the whole team's models, by robot."""

    vehicles: Mapping[str, VehicleModel]
    sensors: Mapping[str, SensorModel]
    area: Area
    ground: Ground | None = None  # None: the area is open
