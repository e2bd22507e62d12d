"""A simulated vehicle: the planner's own vehicle model, run in steps of its control period."""

import math

import numpy as np

from agents.devices import Vehicle, VehicleState
from estimator.arrays import FloatArray
from planner.plan import Trajectory, VehicleModel
from planner.vehicles.power import Powered


class SimulatedVehicle(Vehicle):
    """Advances lazily to the time it is asked about, so that no process has to tick every 5 ms.

    A trajectory begins at its own start_time, to the control step, however late the driver wakes: what was
    predicted is what is flown.
    """

    def __init__(self, model: VehicleModel, start: FloatArray, now: float) -> None:
        self._model = model
        self._period = model.control_period
        self._power = model.power if isinstance(model, Powered) else None
        self._origin = now
        self._steps = 0  # control steps done since `now`
        self._state = model.initial_state(start)
        self._waypoint: FloatArray = np.array(start[:3])
        # At rest where it holds: nothing changes with time. What cannot stop is never idle.
        self._idle = not model.velocity(self._state).any()
        self._detour: FloatArray | None = None
        self._upcoming: list[tuple[int, FloatArray]] = []  # from which step on to steer for which waypoint
        self._travelled = 0.0
        self._climbed = 0.0
        self._last: list[float] = start[:3].tolist()

    def __repr__(self) -> str:
        return f"SimulatedVehicle(steps={self._steps}, waypoint={self._waypoint.round(1)})"

    def follow(self, trajectory: Trajectory | None, now: float) -> None:
        if trajectory is None:
            self._advance_to(self._step_of(now))
            self._upcoming = []
            self._aim(np.array(self._model.pose(self._state)[:3]))
        else:
            starts = np.round((trajectory.route_times - self._origin) / self._period)
            route = list(zip(starts.astype(int).tolist(), trajectory.route, strict=True))
            self._upcoming = [leg for leg in self._upcoming if leg[0] < route[0][0]] + route

    def detour(self, waypoint: FloatArray | None, now: float) -> None:
        if waypoint is None and self._detour is None:
            return
        self.state(now)
        self._detour = waypoint
        self._state = self._model.begin(self._state, self._waypoint if waypoint is None else waypoint)
        self._idle = False

    def state(self, now: float) -> VehicleState:
        target = self._step_of(now)
        while self._upcoming and target >= self._upcoming[0][0]:
            begin, waypoint = self._upcoming.pop(0)
            self._advance_to(max(self._steps, begin))
            self._aim(waypoint)
        self._advance_to(target)
        pose = self._model.pose(self._state)
        here = pose[:3].tolist()
        self._travelled += math.dist(here, self._last)
        self._climbed += max(here[2] - self._last[2], 0.0)
        self._last = here
        return VehicleState(
            time=self._origin + self._steps * self._period,
            pose=pose,
            velocity=self._model.velocity(self._state),
            state=self._state,
            travelled=self._travelled,
            arrived=self._model.reached(self._state, self._waypoint),
            energy=self._spent(),
        )

    def _spent(self) -> float | None:
        if self._power is None:
            return None
        return self._power.joules(self._steps * self._period, self._travelled, self._climbed)

    def _step_of(self, now: float) -> int:
        return max(self._steps, int((now - self._origin) / self._period + 1e-6))

    def _aim(self, waypoint: FloatArray) -> None:
        self._waypoint = np.array(waypoint, dtype=np.float64)
        if self._detour is None:
            self._state = self._model.begin(self._state, self._waypoint)
        self._idle = False

    def _advance_to(self, step: int) -> None:
        if step > self._steps:
            if not self._idle:
                towards = self._waypoint if self._detour is None else self._detour
                self._state = self._model.advance(self._state, towards, step - self._steps)
            self._steps = step
