"""The real vehicle of a robot: `agents.devices.LiveVehicle` over a Bridge.

A copter takes off when the team's time has begun, climbs above where it stands to the altitude of its start,
and follows trajectories from then on. What is streamed is a place a little ahead on the trajectory, so that
it is flown as fast as was planned; a rover, which would stop at each of such places, is given the waypoints.

Between two positions of the autopilot it is believed to go on with its velocity, for half a second at most.
"""

import time
from math import dist

import numpy as np

from agents.clock import Clock
from agents.devices import DeviceContext, LiveVehicle, VehicleHealth, VehicleState
from agents.errors import LinkError, MissionError
from bridges.mavlink.bridge import Bridge
from bridges.mavlink.fence import Fence
from bridges.mavlink.frames import LocalFrame, swapped, turned
from bridges.mavlink.kind import MavlinkConfig
from bridges.mavlink.pilot_report import PilotReport
from bridges.mavlink.placing import place
from bridges.mavlink.signing import read_keys
from bridges.mavlink.speed_errand import SpeedErrand
from bridges.mavlink.steering import Steering
from bridges.mavlink.wanted import GoTo, Land, Rest, Return, Task, Wanted, Way
from bridges.mavlink.ways import way_of
from bridges.mavlink.words import summary
from estimator.arrays import FloatArray
from planner.plan import Trajectory, VehicleModel

FOUND_S = 12.0  # within which something must be heard at the URL
BELIEVED_S = 0.5  # for which it is believed to go on as it did
LISTEN_S = 3.5  # in which a second vehicle with the same id shows
LOOK_S = 0.05
CATCH_UP = 1.2
DOING = {  # phases in which it does not go where the robot wants
    "connecting": "looking for it",
    "introducing": "getting ready",
    "ready": "getting ready",
    "engaging": "getting ready",
    "climbing": "taking off",
    "flying": "climbing",
    "landing": "landing",
    "returning": "returning",
    "taken over": "taken over",
    "lost": "link lost",
    "refused": "refused",
    "failed": "bridge failed",
}
GIVEN_UP = frozenset({"taken over", "landing", "returning", "lost"})  # after which it begins anew


class MavlinkVehicle(LiveVehicle):
    """One vehicle's. Its methods come from the robot's loop; the bridge's thread asks for the fence."""

    def __init__(self, config: MavlinkConfig, model: VehicleModel, context: DeviceContext) -> None:
        self._config = config
        self._context = context
        self._name = context.robot
        area = context.area
        low, high = config.bounds
        if context.altitude is not None:
            low, high = max(low, context.altitude[0]), min(high, context.altitude[1])
        self.fence = Fence(area.low[:2], area.high[:2], (low, high), config.margin_m, context.ground)
        outside = self.fence.forbids(np.array(context.start[:3]))
        if outside is not None:
            raise MissionError(f"robot {self._name}: its start is outside of its fence: {outside}")
        keys = None if config.signing_key is None else read_keys(config.signing_key)
        self._bridge = Bridge(config.url, config.pilot(self._permit, self._breach), keys)
        self._local: LocalFrame | None = None
        self._clock: Clock | None = None
        self._report = self._bridge.report()
        self.steering = Steering(model, config, context)
        self._position: FloatArray = np.array(context.start[:3])
        self._velocity: FloatArray = np.zeros(3)
        self._yaw = float(context.start[3])
        self._captured: float | None = None
        # A mission on board goes on without a link.
        self._flying = {"flying", "following", "lost"} if config.ways == "mission" else {"flying"}
        self._board: tuple[Trajectory, Way] | None = None  # the way that is flown as a mission
        self._travelled = 0.0
        self._ending = False
        self._paced = False  # it was told how fast it may go
        self._team_age = 0.0

    def __repr__(self) -> str:
        return f"MavlinkVehicle({self._name}, {self._report.phase!r}, {self._report.trouble!r})"

    # The fence, asked by the bridge's thread

    def _permit(self, ned: FloatArray) -> str | None:
        local = self._local
        return "its frame is not known" if local is None else self.fence.forbids(local.to_team(ned))

    def _breach(self, ned: FloatArray) -> str | None:
        local = self._local
        return None if local is None else self.fence.left(local.to_team(ned))

    # Before the team starts

    def prepare(self) -> None:
        self._bridge.start()
        begin, heard = time.monotonic(), None
        while True:
            report = self._look()
            waited = time.monotonic() - begin
            if heard is None and report.autopilot:
                heard = waited
            if report.phase == "refused":
                raise MissionError(self._sentence(report.trouble))
            if report.phase in ("connecting", "failed") and waited > FOUND_S:
                raise LinkError(self._sentence(report.trouble))
            if report.phase == "taken over":
                raise MissionError(
                    self._sentence(f"{report.trouble}; land it first, or say take_flying = true")
                )
            if self._local is None:
                placed = place(self._config, self._context, report)
                if placed is not None and placed.wrong:
                    raise MissionError(self._sentence(placed.wrong))
                self._local = None if placed is None else placed.local
            elif report.phase == "ready" and not report.reasons:
                if heard is not None and waited - heard >= LISTEN_S:
                    return
                time.sleep(LOOK_S)
                continue
            if waited > self._config.ready_after_s:
                reasons = "; ".join(report.reasons) or report.trouble or f"it is {report.phase}"
                seconds = f"after {self._config.ready_after_s:g} s (ready_after_s)"
                raise MissionError(self._sentence(f"it may not be armed {seconds}: {reasons}"))
            time.sleep(LOOK_S)

    def _sentence(self, text: str) -> str:
        return f"robot {self._name} at {self._config.url}: {text}"

    def join(self, clock: Clock) -> None:
        if clock.speed != 1.0:
            raise MissionError(
                f"robot {self._name} is a real vehicle, but the team runs at {clock.speed:g} times the "
                "wall's speed; start it with --speed 1"
            )
        self._clock = clock

    # In flight

    def state(self, now: float) -> VehicleState:
        report = self._look()
        time_of_it = now if self._captured is None else min(self._captured + BELIEVED_S, now)
        ahead = 0.0 if self._captured is None else time_of_it - self._captured
        pose = np.array([*(self._position + max(ahead, 0.0) * self._velocity), self._yaw])
        able = report.phase in self._flying and self.steering.up and not self._ending
        return VehicleState(
            time=time_of_it,
            pose=pose,
            velocity=self._velocity,
            state=self.steering.model_state(pose, self._velocity),
            travelled=self._travelled,
            arrived=self.steering.arrived(pose[:3]),
            able=able,
            doing="" if able else DOING.get(report.phase, report.phase),
        )

    def follow(self, trajectory: Trajectory | None, now: float) -> None:
        self.steering.follow(trajectory, now, self.state(now).pose[:3])
        self._steer(now, None)

    def detour(self, waypoint: FloatArray | None, now: float) -> None:
        self.steering.aside = waypoint
        self._steer(now, None)

    def tend(self, now: float, team_age: float) -> None:
        self._steer(now, team_age)

    def _steer(self, now: float, team_age: float | None) -> None:
        """Tell the bridge where to steer; as old as before is what is not known of the team."""
        if team_age is not None:
            self._team_age = team_age
        if self._clock is None or self._ending:
            return
        report = self._look()
        self.steering.look(report.phase, self._position)
        if report.phase in GIVEN_UP - self._flying:
            self.steering.begin()
            self._paced = False
        elif report.phase == "flying" and not self._paced:
            self._pace(report)
        self._bridge.want(Wanted(self._task(now), self._team_age))

    def _pace(self, report: PilotReport) -> None:
        """A mode change lets an ArduPilot forget it; a copter that is late may catch up."""
        self._paced = True
        if report.autopilot == "ArduPilot" and report.system is not None:
            share = CATCH_UP if self._config.body == "copter" else 1.0
            self._bridge.run(SpeedErrand(report.system, share * self._config.speed_m_s))

    def _task(self, now: float) -> Task:
        local = self._local
        target = None if self._captured is None else self.steering.target(now, self._position)
        way, home = self.steering.way, self._report.home
        if self._config.ways == "mission" and way is not None and local is not None and home is not None:
            if self._board is None or self._board[0] is not way:
                self._board = (way, way_of(way.route, local, home, self._config.tolerance_m))
            return self._board[1]
        return Rest() if local is None or target is None else GoTo(local.to_ned(target))

    def _look(self) -> PilotReport:
        """Take in the newest report."""
        report = self._bridge.report()
        fresh = report.captured is not None and report.captured != self._report.captured
        self._report = report
        local = self._local
        if local is None or report.position is None or report.velocity is None:
            return report
        if report.origin is not None and report.origin != local.origin:
            self._local = local = LocalFrame(local.team, report.origin, local.autopilot)
        if fresh or self._captured is None:
            position = local.to_team(report.position)
            if self._captured is not None:
                self._travelled += dist(position, self._position)
            self._position, self._velocity = position, swapped(report.velocity)
        if report.attitude is not None:
            self._yaw = turned(report.attitude[2])
        if self._clock is not None and report.captured is not None:
            self._captured = self._clock.now() - (time.monotonic() - report.captured)
        return report

    def astray(self, now: float) -> bool:
        return self.steering.astray(now, self._position)

    # For people

    def news(self) -> list[tuple[str, str]]:
        return [(event.level, event.text) for event in self._bridge.events()]

    def health(self) -> VehicleHealth:
        report = self._bridge.report()
        counters = {f"mavlink.{name}": count for name, count in (report.counters or {}).items()}
        gauges = report.gauges() | self.steering.gauges()
        gauges |= {"mavlink.ours": float(report.ours), "mavlink.trouble": float(bool(report.trouble))}
        return VehicleHealth(summary(report), gauges, counters | self.steering.counters())

    def resume(self) -> None:
        self._bridge.resume()

    # The end

    def leave(self) -> bool:
        self._ending = True
        report = self._bridge.report()
        if not report.ours and report.phase not in ("ready", "engaging"):
            return True  # never found, or in somebody else's hands
        if report.phase == "ready" and not report.armed:
            return True
        self._bridge.want(Wanted(Land() if self._config.at_end == "land" else Return()))
        by_itself = {"LAND", "RTL"} if self._config.body == "copter" else {"HOLD", "RTL"}
        return report.phase in ("landing", "returning") and report.mode in by_itself

    def close(self) -> None:
        self._bridge.close()
