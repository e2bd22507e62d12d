"""Where a vehicle is to steer for now: up to its start, along a trajectory, or aside."""

import numpy as np

from agents.devices import DeviceContext
from bridges.mavlink.kind import MavlinkConfig
from estimator.arrays import FloatArray
from planner.plan import Trajectory, VehicleModel

AHEAD_S = 1.2  # a place so far ahead on the trajectory: position controllers lag about a second behind
LATE_S = 2.0  # by which it may be late, which waiting at its waypoints makes up for
AMEND_S = 2.0  # between two times that its way is reckoned anew
WAIT_S = 4.0  # a way that should begin waits so long for the one before to end
CHAINED_S = 0.3  # a way that begins no earlier before another's end goes on from there
UP_M = 0.7  # so near to its start's altitude it is up


class Steering:
    """In the team's frame and time. No clock, no link."""

    def __init__(self, model: VehicleModel, config: MavlinkConfig, context: DeviceContext) -> None:
        self._model = model
        self._config = config
        self._flies = config.body == "copter"
        self._start: FloatArray = np.array(context.start, dtype=np.float64)
        self._level = context.area.dimension == 2
        self.up = False  # it is at its start's altitude, and goes where it is told
        self._climb: FloatArray | None = None  # (3,) above where it stands
        self._way: Trajectory | None = None
        self._next: Trajectory | None = None
        self._held: FloatArray | None = None
        self.aside: FloatArray | None = None  # (3,) to keep apart from others
        self._amended = -np.inf
        self._waypoints = 0
        self._nearest = np.inf  # m to the waypoint of the way
        self._last_m: float | None = None
        self._worst_m = 0.0

    def __repr__(self) -> str:
        return f"Steering(up={self.up}, climb={self._climb}, aside={self.aside})"

    def begin(self) -> None:
        """From the ground, or from wherever it is given back to us."""
        self.up = False
        self._climb = self._way = self._next = self._held = self.aside = None

    def look(self, phase: str, here: FloatArray) -> None:
        """It is `here` (3,)."""
        if phase == "flying" and not self.up and self._climb is not None:
            self.up = not self._flies or abs(float(here[2] - self._climb[2])) < UP_M
            self._held = self._climb
        if self._way is not None:
            self._nearest = min(self._nearest, float(np.linalg.norm(here - self._way.waypoint)))

    def follow(self, trajectory: Trajectory | None, now: float, here: FloatArray) -> None:
        """A way from its start time on, or hold `here`."""
        if trajectory is None:
            self._done(now)
            self._way, self._next = None, None
            self._held = self._levelled(here)
        elif self._way is None or (trajectory.start_time <= now < self._way.end_time):
            self._done(now)
            self._way, self._next, self._nearest = trajectory, None, np.inf
        else:
            self._next = trajectory

    def _done(self, now: float) -> None:
        """Keep the score of the way that ends."""
        way = self._way
        if way is None or now < way.end_time or self.aside is not None:
            return
        self._waypoints += 1
        self._last_m = self._nearest
        self._worst_m = max(self._worst_m, self._nearest)

    def target(self, now: float, here: FloatArray) -> FloatArray | None:
        """The place (3,) to steer for."""
        if not self.up:
            if self._climb is None:
                height = self._start[2] if self._flies else here[2]
                self._climb = np.array([here[0], here[1], height])
            return self._climb
        if self._next is not None and now >= self._next.start_time and self._there(now, here):
            self._done(now)
            self._way, self._next, self._nearest = self._next, None, np.inf
        if self.aside is not None:
            return self.aside
        if self._way is None:
            return self._held
        return self._ahead(self._way, now, here) if self._flies else self._leg(self._way, now)

    @property
    def way(self) -> Trajectory | None:
        """That is flown now; None: it climbs, holds, or gives way."""
        return self._way if self.up and self.aside is None else None

    def _ahead(self, way: Trajectory, now: float, here: FloatArray) -> FloatArray:
        """A place on the way, but never so far that it would be flown to faster than the mission allows."""
        when = now + AHEAD_S
        if when >= way.end_time:
            place = np.array(way.waypoint)
        else:
            place = np.array([np.interp(when, way.times, way.poses[:, axis]) for axis in range(3)])
        gap, most = place - here, 1.0 + self._config.speed_m_s * 1.3
        far = float(np.linalg.norm(gap))
        return place if far <= most else here + gap * (most / far)

    def _leg(self, way: Trajectory, now: float) -> FloatArray:
        index = max(0, int(np.searchsorted(way.route_times, now + 1e-9, side="right")) - 1)
        return np.array(way.route[index])

    def _there(self, now: float, here: FloatArray) -> bool:
        """Whether it may go on to the next way: not before it has been at its waypoint, if that is near."""
        way, following = self._way, self._next
        if way is None or following is None or self.aside is not None:
            return True
        if following.start_time < way.end_time - CHAINED_S:
            return True  # the robot has thought better of it
        return self._near(way.waypoint, here) or now >= following.start_time + WAIT_S

    def _near(self, waypoint: FloatArray, here: FloatArray) -> bool:
        axes = 3 if self._flies else 2
        return float(np.linalg.norm((here - waypoint)[:axes])) <= self._config.tolerance_m

    def astray(self, now: float, here: FloatArray) -> bool:
        """Whether it is so far from where it should be by now that its way is to be reckoned anew."""
        way = self._way
        if not self.up or way is None or self.aside is not None or now < self._amended + AMEND_S:
            return False
        if not way.start_time < now < way.end_time:
            return False
        planned = np.array([np.interp(now, way.times, way.poses[:, axis]) for axis in range(3)])
        axes = 3 if self._flies else 2
        if np.linalg.norm((here - planned)[:axes]) <= 1.0 + LATE_S * self._config.speed_m_s:
            return False
        self._amended = now
        return True

    def arrived(self, here: FloatArray) -> bool:
        """At the waypoint last given, or none was given."""
        way = self._next or self._way
        return way is None or self._near(way.waypoint, here)

    def model_state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """The state (n,) that predictions begin with.

        In an area of two axes it keeps to its start's altitude: what its altimeter is off would otherwise
        add up from plan to plan.
        """
        begin = np.array(pose)
        if self._level or not self._flies:
            begin[2] = self._start[2]
        state = self._model.initial_state(begin)
        if self._flies:
            state[4:7] = velocity
            if self._level:
                state[6] = 0.0
        else:
            state[4] = float(np.hypot(velocity[0], velocity[1]))
        return state

    def _levelled(self, here: FloatArray) -> FloatArray:
        held = np.array(here)
        if self._level and self._flies:
            held[2] = self._start[2]
        return held

    def gauges(self) -> dict[str, float]:
        """How near it came to its waypoints, m."""
        if self._last_m is None:
            return {}
        return {"mavlink.waypoint_m": self._last_m, "mavlink.waypoint_worst_m": self._worst_m}

    def counters(self) -> dict[str, int]:
        return {"mavlink.waypoints": self._waypoints}
