"""Bodies that outlive the process that drives them, whatever its clock says."""

from collections.abc import Callable
from dataclasses import replace

from agents.clock import Clock
from agents.devices import Sensor, Vehicle, VehicleState
from estimator.arrays import FloatArray
from planner.plan import Trajectory

SETPOINTS_S = 1.0  # an autopilot that is told nothing for so long holds where it is


class SteadyVehicle(Vehicle):
    """A vehicle in true time, told what to do in the time of a process's clock."""

    def __init__(self, vehicle: Vehicle, true_time: Callable[[], float]) -> None:
        self.follows_plans = vehicle.follows_plans
        self._vehicle = vehicle
        self._true = true_time
        self._clock: Clock | None = None
        self._travelled_before = 0.0

    def __repr__(self) -> str:
        return f"SteadyVehicle({self._vehicle!r})"

    def boot(self, clock: Clock) -> None:
        """A process with this clock drives it from now on; metres count anew."""
        self._clock = clock
        self._travelled_before = self._vehicle.state(self._true()).travelled

    def truly(self) -> VehicleState:
        """How it is now, in true time."""
        return self._vehicle.state(self._true())

    def hold(self) -> None:
        """What the autopilot does by itself when nobody tells it anything."""
        now = self._true()
        self._vehicle.detour(None, now)
        self._vehicle.follow(None, now)

    def state(self, now: float) -> VehicleState:
        ahead = self._ahead()
        state = self._vehicle.state(now - ahead)
        if ahead == 0.0 and self._travelled_before == 0.0:
            return state
        return replace(state, time=state.time + ahead, travelled=state.travelled - self._travelled_before)

    def follow(self, trajectory: Trajectory | None, now: float) -> None:
        ahead = self._ahead()
        if trajectory is not None and ahead != 0.0:
            trajectory = replace(
                trajectory,
                start_time=trajectory.start_time - ahead,
                end_time=trajectory.end_time - ahead,
                measure_times=trajectory.measure_times - ahead,
                times=trajectory.times - ahead,
                route_times=trajectory.route_times - ahead,
            )
        self._vehicle.follow(trajectory, now - ahead)

    def detour(self, waypoint: FloatArray | None, now: float) -> None:
        self._vehicle.detour(waypoint, now - self._ahead())

    def close(self) -> None:
        self._vehicle.close()

    def _ahead(self) -> float:
        """What the process's clock shows more than is true."""
        return 0.0 if self._clock is None else self._clock.now() - self._true()


class SteadySensor(Sensor):
    """A sensor that sees the world as it is now, whatever time the process believes it to be."""

    def __init__(self, sensor: Sensor, true_time: Callable[[], float]) -> None:
        self._sensor = sensor
        self._true = true_time
        self._clock: Clock | None = None

    def boot(self, clock: Clock) -> None:
        """A process with this clock reads it from now on."""
        self._clock = clock

    def measure(self, now: float, pose: FloatArray) -> FloatArray:
        ahead = 0.0 if self._clock is None else self._clock.now() - self._true()
        return self._sensor.measure(now - ahead, pose)

    def next_capture(self, after: float) -> float | None:
        return self._sensor.next_capture(after)

    def close(self) -> None:
        self._sensor.close()
