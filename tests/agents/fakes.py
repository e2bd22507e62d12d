"""Simple stand-ins for the parts around the agents."""

from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from agents.devices import VehicleState
from agents.mission.mission import Mission
from estimator.arrays import FloatArray
from estimator.sensor import Look
from planner.plan import Plan, Predictions, Trajectory

SPEED = 1.0
PERIOD = 0.1


class FakeSensor:
    """Sees everything within 10 m, surely."""

    dimension = 2
    measurement_size = 2

    def detection(self, points: FloatArray, poses: FloatArray) -> FloatArray:
        delta = points[None, :, :] - poses[:, :2, None]
        return np.asarray((np.hypot(delta[:, 0], delta[:, 1]) < 10.0).astype(float))

    def look(self, points: FloatArray, pose: FloatArray, measurements: FloatArray) -> Look:
        raise AssertionError("not needed here")

    locate = location_covariance = sample = outline = look  # type: ignore[assignment]


class FakeVehicle:
    """Moves at 1 m/s straight to its waypoint; the state is (x, y, z, yaw)."""

    control_period = PERIOD

    def initial_state(self, pose: FloatArray) -> FloatArray:
        return np.array(pose, dtype=float)

    def pose(self, state: FloatArray) -> FloatArray:
        return np.array(state)

    def velocity(self, state: FloatArray) -> FloatArray:
        return np.zeros(3)

    def begin(self, state: FloatArray, waypoint: FloatArray) -> FloatArray:
        return np.array(state)

    def advance(self, state: FloatArray, waypoint: FloatArray, steps: int) -> FloatArray:
        state = np.array(state)
        for _ in range(steps):
            way = waypoint - state[:3]
            distance = float(np.linalg.norm(way))
            state[:3] += way if distance <= SPEED * PERIOD else way / distance * SPEED * PERIOD
        return state

    def reached(self, state: FloatArray, waypoint: FloatArray) -> bool:
        return bool(np.linalg.norm(state[:3] - waypoint) < 1e-6)

    def predict(self, state: FloatArray, waypoints: FloatArray, measure_period: float) -> Predictions:
        raise AssertionError("not needed here")

    def trajectory(
        self, state: FloatArray, waypoint: FloatArray, start_time: float, measure_period: float
    ) -> Trajectory:
        duration = float(np.linalg.norm(waypoint - state[:3])) / SPEED
        end = np.append(waypoint, 0.0)
        return Trajectory(
            waypoint=waypoint,
            start_time=start_time,
            end_time=start_time + duration,
            measure_times=np.arange(start_time, start_time + duration, measure_period),
            measure_poses=np.tile(end, (len(np.arange(0.0, duration, measure_period)), 1)),
            times=np.array([start_time, start_time + duration]),
            poses=np.array([state, end]),
            end_state=end,
            control_cost=0.0,
            route=waypoint[None],
            route_times=np.array([start_time]),
        )


def mission(robots: int = 2, **changes: Any) -> Mission:
    """A small mission; `changes` are top-level keys."""
    table: dict[str, Any] = {
        "name": "fake",
        "team": "t",
        "area": {"min": [0, 0], "max": [100, 100]},
        "world": {"kind": "uniform", "targets": 1},
        "filter": {"kind": "smc_phd"},
        "planner": {"kind": "maasi"},
        "exploration": {"points": [11, 11]},
        "robots": [
            {"id": f"r{i + 1}", "start": [0, 10 * i], "vehicle": {"kind": "x"}, "sensor": {"kind": "x"}}
            for i in range(robots)
        ],
    }
    return msgspec.convert(table | changes, Mission)


@dataclass
class FakeBody:
    """Follows what a robot says, exactly and at once."""

    model: FakeVehicle = field(default_factory=FakeVehicle)
    trajectory: Trajectory | None = None
    at: FloatArray = field(default_factory=lambda: np.zeros(4))

    def state(self, now: float) -> VehicleState:
        pose, arrived = self.at, True
        if self.trajectory is not None and now >= self.trajectory.start_time:
            share = (now - self.trajectory.start_time) / (
                self.trajectory.end_time - self.trajectory.start_time
            )
            first, last = self.trajectory.poses[0], self.trajectory.poses[-1]
            pose, arrived = first + min(share, 1.0) * (last - first), share >= 1.0
        return VehicleState(now, pose, np.zeros(3), pose, 0.0, arrived)


def plan_to(x: float, y: float, start: FloatArray, start_time: float, period: float = 1.0) -> Plan:
    """A plan straight to a place."""
    trajectory = FakeVehicle().trajectory(start, np.array([x, y, 0.0]), start_time, period)
    return Plan(trajectory, "told so")
