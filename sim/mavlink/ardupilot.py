"""ArduPilot 4.6, copter and rover, as far as a companion computer can tell.

What it does was measured on the real one (arming, take-off, setpoint groups, GUID_TIMEOUT, streams only
when asked, GCS failsafe that counts SYSID_MYGCS only) or follows its documentation.
"""

import math
from collections.abc import Callable
from functools import partial

from bridges.mavlink.dialect import Message
from sim.mavlink import ardupilot_commands as does
from sim.mavlink import telemetry
from sim.mavlink.ardupilot_failsafes import NEED_NO_POSITION, RETURNING, Failsafes
from sim.mavlink.autopilot import CRITICAL, INFO, TICK, WARNING, Autopilot
from sim.mavlink.battery import Battery
from sim.mavlink.body import Limits
from sim.mavlink.commands import (
    ACCEPTED,
    ARM_DISARM,
    FAILED,
    FORCE,
    LAND,
    REPOSITION,
    RETURN,
    SET_MODE_COMMAND,
    TAKEOFF,
    UNSUPPORTED,
    Command,
)  # fmt: skip
from sim.mavlink.fence import outside
from sim.mavlink.geodesy import FlatEarth
from sim.mavlink.mission_run import COMMANDS
from sim.mavlink.parameter_tables import ARDUCOPTER, ARDUROVER
from sim.mavlink.parameters import Parameters
from sim.mavlink.plans import Plans
from sim.mavlink.setpoints import FORCE as FORCE_BIT
from sim.mavlink.setpoints import Setpoint, known
from sim.mavlink.settings import Settings

COPTER_MODES = {
    "STABILIZE": 0, "ACRO": 1, "ALT_HOLD": 2, "AUTO": 3, "GUIDED": 4, "LOITER": 5, "RTL": 6, "CIRCLE": 7,
    "LAND": 9, "POSHOLD": 16, "BRAKE": 17, "GUIDED_NOGPS": 20, "SMART_RTL": 21,
}  # fmt: skip
ROVER_MODES = {
    "MANUAL": 0, "ACRO": 1, "STEERING": 3, "HOLD": 4, "LOITER": 5, "AUTO": 10, "RTL": 11, "SMART_RTL": 12,
    "GUIDED": 15,
}  # fmt: skip
NOT_ARMABLE = {"RTL", "LAND", "SMART_RTL", "CIRCLE", "BRAKE"}


class ArduPilot(Autopilot):
    """`Autopilot` with ArduPilot's ways."""

    wire_autopilot = 3
    version = (4 << 24) | (6 << 16) | (2 << 8) | 255
    capabilities = 1 | 2 | 4 | 8 | 128 | 256 | 0x800 | 0x1000 | 0x2000 | 0x4000
    home_is_item_0 = 1
    mission_yaws = False
    builders = telemetry.ARDUPILOT

    def __init__(self, settings: Settings) -> None:
        self.modes = COPTER_MODES if settings.type == "copter" else ROVER_MODES
        self.holding = "LOITER" if settings.type == "copter" else "HOLD"
        self.last_setpoint = 0.0
        table = ARDUCOPTER if settings.type == "copter" else ARDUROVER
        changed = {"SYSID_THISMAV": settings.system_id} | settings.parameters
        super().__init__(
            settings,
            Parameters(table, bytewise=False, changed=changed),
            FlatEarth(settings.home[0], settings.home[1]),
            Plans(COMMANDS, home_first=True),
            Battery(settings.flight_time, full=12.6, empty=10.2),
        )
        self.failsafes = Failsafes(self)
        self.commands: dict[int, Callable[[Command], int]] = {
            ARM_DISARM: self._arm_disarm,
            SET_MODE_COMMAND: lambda c: self._change_mode(c.params[0], c.params[1]),
            11: lambda c: self._change_mode(c.params[0], c.params[1]),
            RETURN: lambda _: self.simple_mode("RTL"),
            17: lambda _: self.simple_mode("LOITER"),
            300: partial(does.start_mission, self),
            REPOSITION: partial(does.reposition, self),
            178: partial(does.change_speed_command, self),
            193: partial(does.pause, self),
            207: partial(does.enable_fence, self),
            401: self._check_arming,
        }
        if settings.type == "copter":
            self.commands |= {
                TAKEOFF: partial(does.take_off, self),
                LAND: lambda _: self.simple_mode("LAND"),
                115: partial(does.yaw, self),
            }

    # --- modes ---

    def first_mode(self) -> str:
        return "STABILIZE" if self.settings.type == "copter" else "MANUAL"

    def base_mode(self) -> int:
        manual = self.mode in ("STABILIZE", "ACRO", "MANUAL")
        guided = self.mode in ("GUIDED", "AUTO", "RTL", "LOITER", "SMART_RTL")
        return 1 | (128 if self.armed else 0) | (64 if manual else 16) | (8 if guided else 0)

    def custom_mode(self) -> int:
        return self.modes[self.mode]

    def set_mode(self, mode: str, why: str = "") -> str | None:
        trouble = self._mode_trouble(mode)
        if trouble is not None:
            self.say(WARNING, f"Mode change to {mode} failed: {trouble}")
            return trouble
        if mode == self.mode:
            return None
        if self.fault("stuck_mode") and why != "RC":
            return None
        self.mode = mode
        self.mission.stop()
        if mode == "LAND":
            self.guidance.land()
        elif mode in RETURNING:
            self.begin_return()
        elif mode == "AUTO":
            self.mission.start()
        elif self.body.on_ground and self.body.flies:
            self.guidance.rest()
        else:
            self.guidance.hold()
        return None

    def _mode_trouble(self, mode: str) -> str | None:
        if mode not in self.modes:
            return "no such mode"
        if mode not in NEED_NO_POSITION and not self.has_position():
            return "requires position"
        if mode == "AUTO" and not self.mission.items:
            return "init failed"
        if mode == "AUTO" and self.armed and self.body.on_ground and self.settings.type == "copter":
            commands = [item.command for item in self.mission.items]
            if commands[0] != 22:
                return "Auto: Missing Takeoff Cmd"
        return None

    def simple_mode(self, mode: str) -> int:
        return FAILED if self.set_mode(mode) else ACCEPTED

    def _change_mode(self, base: float, number: float) -> int:
        if not int(base) & 1:
            return UNSUPPORTED
        name = next((name for name, value in self.modes.items() if value == number), None)
        if name is None:
            self.say(WARNING, f"No such mode {int(number)}")
            return FAILED
        return self.simple_mode(name)

    def begin_return(self) -> None:
        height = self.parameters["RTL_ALT"] / 100 if self.settings.type == "copter" else 0.0
        home = self.home_local()
        self.guidance.back(home, home[2] - height, lands=self.settings.type == "copter")

    def first_home(self) -> tuple[float, float, float]:
        """A rover's is set before its estimator knows its altitude, and kept."""
        latitude, longitude, altitude = super().first_home()
        return latitude, longitude, altitude if self.settings.type == "copter" else 0.14

    # --- arming ---

    def arming_trouble(self) -> str | None:
        refused = self.refusal()
        if refused is not None:
            return refused
        if not self.parameters["ARMING_CHECK"]:
            return None
        if self.mode not in NEED_NO_POSITION and not self.has_position():
            return None if self.fault("arms_without_position") else "Need Position Estimate"
        if self.fault("bad_estimate"):
            return "EKF variance"
        if self.battery.left < 0.02:
            return "Battery 1 below minimum arming voltage"
        return None

    def _check_arming(self, command: Command) -> int:
        trouble = self.arming_trouble()
        if trouble:
            self.say(CRITICAL, f"PreArm: {trouble}")
        return ACCEPTED

    def _arm_disarm(self, command: Command) -> int:
        forced = command.params[1] == FORCE
        if command.params[0] == 0.0:
            if self.armed and not self.body.on_ground and self.body.flies and not forced:
                return FAILED
            if self.armed:
                self.say(INFO, "Disarming motors")
                self.disarm()
            return ACCEPTED
        if command.params[0] != 1.0:
            return UNSUPPORTED
        if self.armed:
            return ACCEPTED
        trouble = f"{self.mode} mode not armable" if self.mode in NOT_ARMABLE else self.arming_trouble()
        if trouble is not None and not forced:
            self.say(CRITICAL, f"Arm: {trouble}")
            return FAILED
        self.say(INFO, "Arming motors")
        self.arm()
        return ACCEPTED

    # --- flying ---

    def change_speed(self, speed: float) -> None:
        if self.settings.type == "copter":
            self.parameters["WPNAV_SPEED"] = speed * 100
        else:
            self.parameters["WP_SPEED"] = speed

    def setpoint(self, message: Message) -> None:
        """A whole group or nothing: one ignored or unknown axis discards the group that it is in."""
        if self.mode != "GUIDED" or message.get_type() == "SET_ATTITUDE_TARGET":
            return
        if self.body.on_ground and self.body.flies and self.guidance.task != "takeoff":
            return
        wanted = Setpoint.of(message, self)
        if wanted is None or wanted.mask & FORCE_BIT:
            return
        yaw, rate = known(wanted.yaw), known(wanted.yaw_rate)
        if wanted.whole(wanted.position):
            if self.inside_fence(wanted.position):
                self.guidance.goto(wanted.position, yaw, rate)
                self.last_setpoint = math.inf  # flown and held
        elif wanted.whole(wanted.velocity):
            self.guidance.drive(wanted.velocity, yaw, rate)
            self.last_setpoint = self.now

    def plans_changed(self, kinds: set[int]) -> None:
        super().plans_changed(kinds)
        self.parameters["MIS_TOTAL"] = len(self.plans.items[0]) + 1
        self.parameters["FENCE_TOTAL"] = len(self.plans.items[1])

    def inside_fence(self, position: tuple[float, float, float]) -> bool:
        """Whether an enabled fence lets it go there."""
        if not self.parameters["FENCE_ENABLE"]:
            return True
        kinds = int(self.parameters["FENCE_TYPE"])
        home = self.home_local()
        if kinds & 1 and self.body.flies and home[2] - position[2] > self.parameters["FENCE_ALT_MAX"]:
            return False
        if kinds & 2 and math.dist(home[:2], position[:2]) > self.parameters["FENCE_RADIUS"]:
            return False
        return not (kinds & 4 and outside(self.plans.items[1], self.projection, position))

    def heard_heartbeat(self, message: Message) -> None:
        """Only the ground station of SYSID_MYGCS counts, whatever else is heard."""
        if message.get_srcSystem() == int(self.parameters["SYSID_MYGCS"]):
            self.failsafes.heard_station()

    # --- every tick ---

    def fly(self) -> None:
        self._set_limits()
        if self.mode == "AUTO" and self.armed:
            self.mission.tick(TICK)  # after its last item it stays there, in AUTO
        if self.armed:
            self.failsafes.check()
            self._time_out()
            self._rest_disarmed()

    def _set_limits(self) -> None:
        p, guidance = self.parameters, self.guidance
        if self.settings.type == "rover":
            guidance.limits = Limits(max(p["WP_SPEED"], 0.1), 1.0, 1.0)
            return
        level = max(p["WPNAV_SPEED"] / 100, 0.2)
        if self.mode in RETURNING and p["RTL_SPEED"] > 0:
            level = p["RTL_SPEED"] / 100
        guidance.limits = Limits(level, p["WPNAV_SPEED_UP"] / 100, p["WPNAV_SPEED_DN"] / 100)
        guidance.land_speed = p["LAND_SPEED"] / 100
        guidance.faces_way = p["WP_YAW_BEHAVIOR"] != 0

    def _time_out(self) -> None:
        driven = self.mode == "GUIDED" and self.guidance.task == "drive"
        if driven and self.now - self.last_setpoint > self.parameters["GUID_TIMEOUT"]:
            self.guidance.hold()

    def _rest_disarmed(self) -> None:
        """Landed in LAND or RTL: disarmed at once; idle on the ground: after DISARM_DELAY."""
        if not self.body.flies or not self.body.on_ground:
            if not self.body.on_ground:
                self.armed_at = self.now
            return
        landing = self.guidance.task == "land" and self.now - self.armed_at > 1.0
        delay = self.parameters["DISARM_DELAY"]
        if landing or (delay > 0 and self.now - self.armed_at > delay):
            self.say(INFO, "Disarming motors")
            self.disarm()
