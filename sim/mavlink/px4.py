"""PX4 1.16, multicopter, as far as a companion computer can tell.

What it does was measured on the real one (OFFBOARD needs a stream of setpoints before and all the time, per
axis masks, telemetry) or follows its documentation.
"""

import math
from collections.abc import Callable
from functools import partial

from bridges.mavlink.dialect import Message
from sim.mavlink import px4_commands as does
from sim.mavlink import telemetry
from sim.mavlink.autopilot import CRITICAL, INFO, TICK, WARNING, Autopilot
from sim.mavlink.battery import Battery
from sim.mavlink.body import Limits
from sim.mavlink.commands import (
    ACCEPTED,
    ARM_DISARM,
    BUSY,
    DENIED,
    FORCE,
    LAND,
    REPOSITION,
    RETURN,
    SET_MODE_COMMAND,
    TAKEOFF,
    UNSUPPORTED,
    Command,
)  # fmt: skip
from sim.mavlink.geodesy import Azimuthal
from sim.mavlink.mission_run import COMMANDS
from sim.mavlink.parameter_tables import PX4 as TABLE
from sim.mavlink.parameters import Parameters
from sim.mavlink.plans import Plans
from sim.mavlink.px4_failsafes import NEED_NO_POSITION, Failsafes
from sim.mavlink.setpoints import BODY_NED, LOCAL_NED, Setpoint, known
from sim.mavlink.settings import Settings

MODES = {  # main mode, sub mode
    "MANUAL": (1, 0), "ALTCTL": (2, 0), "POSCTL": (3, 0), "ACRO": (5, 0), "OFFBOARD": (6, 0),
    "STABILIZED": (7, 0), "TAKEOFF": (4, 2), "HOLD": (4, 3), "MISSION": (4, 4), "RTL": (4, 5), "LAND": (4, 6),
}  # fmt: skip
NOT_ARMABLE = {"RTL", "LAND"}
GAP = 0.5  # s: a longer pause begins a new stream of setpoints
STATION = 2.5  # s since a ground station's last heartbeat in which it counts as connected


class Px4(Autopilot):
    """`Autopilot` with PX4's ways."""

    wire_autopilot = 12
    version = (1 << 24) | (16 << 16) | (1 << 8) | 255
    capabilities = 2 | 4 | 16 | 64 | 128 | 256 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x10000
    home_is_item_0 = 0
    mission_yaws = True
    builders = telemetry.PX4

    def __init__(self, settings: Settings) -> None:
        self._stream: tuple[float, float] | None = None  # when it began, when the last setpoint came
        self._flown = False
        self._station = -math.inf
        super().__init__(
            settings,
            Parameters(
                TABLE, bytewise=True, changed={"MAV_SYS_ID": settings.system_id} | settings.parameters
            ),
            Azimuthal(settings.home[0], settings.home[1]),
            Plans(COMMANDS, home_first=False),
            Battery(settings.flight_time, full=16.2, empty=14.0),
        )
        self.failsafes = Failsafes(self)
        self._cruise = self.parameters["MPC_XY_CRUISE"]
        self.guidance.faces_way = True
        self.commands: dict[int, Callable[[Command], int]] = {
            ARM_DISARM: self._arm_disarm,
            SET_MODE_COMMAND: lambda c: self._change_mode(*c.params[:3]),
            11: lambda c: self._change_mode(
                c.params[0], float(int(c.params[1]) >> 16 & 255), float(int(c.params[1]) >> 24)
            ),
            TAKEOFF: partial(does.take_off, self),
            LAND: lambda _: self.simple_mode("LAND"),
            RETURN: lambda _: self.simple_mode("RTL"),
            17: lambda _: self.simple_mode("HOLD"),
            300: partial(does.start_mission, self),
            REPOSITION: partial(does.reposition, self),
            178: partial(does.change_speed_command, self),
            193: lambda c: self.simple_mode("MISSION" if c.params[0] else "HOLD"),
            401: self._check_arming,
        }

    # --- modes ---

    def first_mode(self) -> str:
        return "HOLD"

    def base_mode(self) -> int:
        main = MODES[self.mode][0]
        return 1 | (128 if self.armed else 0) | (64 | 16 if main < 4 else 16 | 8 | 4)

    def custom_mode(self) -> int:
        main, sub = MODES[self.mode]
        return main << 16 | sub << 24

    def set_mode(self, mode: str, why: str = "") -> str | None:
        trouble = self._mode_trouble(mode)
        if trouble is not None:
            self.say(CRITICAL, f"Switching to mode '{mode}' is currently not possible")
            return trouble
        if mode == self.mode or (self.fault("stuck_mode") and why != "RC"):
            return None
        self.mode = mode
        self.mission.stop()
        if mode == "LAND":
            self.guidance.land()
        elif mode == "RTL":
            self.begin_return()
        elif mode == "MISSION":
            self.mission.start()
        elif mode == "TAKEOFF":
            self.rise(self.parameters["MIS_TAKEOFF_ALT"] - self.home_local()[2])
        elif self.body.on_ground:
            self.guidance.rest()
        else:
            self.guidance.hold()
        return None

    def _mode_trouble(self, mode: str) -> str | None:
        if mode not in MODES:
            return "no such mode"
        if mode not in NEED_NO_POSITION and mode != "HOLD" and not self.has_position():
            return "no position"
        if mode == "MISSION" and not self.mission.items:
            return "no mission"
        return None

    def simple_mode(self, mode: str) -> int:
        return BUSY if self.set_mode(mode) else ACCEPTED

    def _change_mode(self, base: float, main: float, sub: float) -> int:
        if not int(base) & 1:
            return DENIED
        wanted = (int(main), int(sub) if main == 4 else 0)
        name = next((name for name, value in MODES.items() if value == wanted), None)
        return DENIED if name is None else self.simple_mode(name)

    def begin_return(self) -> None:
        home = self.home_local()
        self.guidance.back(home, home[2] - self.parameters["RTL_RETURN_ALT"])

    # --- arming ---

    def arming_trouble(self) -> str | None:
        refused = self.refusal()
        if refused is not None:
            return refused
        if self.mode not in NEED_NO_POSITION and not self.has_position():
            return None if self.fault("arms_without_position") else "No valid position estimate"
        if self.fault("bad_estimate"):
            return "Position estimate not stable"
        if self.battery.left < self.parameters["BAT_CRIT_THR"]:
            return "Low battery"
        return None

    def _check_arming(self, command: Command) -> int:
        trouble = self.arming_trouble()
        if trouble:
            self.say(WARNING, f"Preflight Fail: {trouble}")
        return ACCEPTED

    def _arm_disarm(self, command: Command) -> int:
        forced = command.params[1] == FORCE
        if command.params[0] == 0.0:
            if self.armed and not self.body.on_ground and not forced:
                self.say(CRITICAL, "Disarming denied: not landed")
                return BUSY
            if self.armed:
                self.say(INFO, "Disarmed by external command")
                self.disarm()
            return ACCEPTED
        if command.params[0] != 1.0:
            return UNSUPPORTED
        if self.armed:
            return ACCEPTED
        trouble = f"not possible in mode {self.mode}" if self.mode in NOT_ARMABLE else self.arming_trouble()
        if trouble is not None and not forced:
            self.say(WARNING, f"Preflight Fail: {trouble}")
            self.say(CRITICAL, "Arming denied: Resolve system health failures first")
            return BUSY
        self.say(INFO, "Armed by external command")
        self.arm()
        self._flown = False
        return ACCEPTED

    # --- flying ---

    def rise(self, height: float) -> None:
        """To a height above the origin."""
        self.guidance.take_off(min(-height, self.body.position[2]))

    def change_speed(self, speed: float) -> None:
        self._cruise = speed

    def setpoint(self, message: Message) -> None:
        """Any axis may be left open. Every setpoint keeps the stream alive, flown or not."""
        now = self.now
        fresh = self._stream is None or now - self._stream[1] > GAP
        self._stream = (now if fresh or self._stream is None else self._stream[0], now)
        if self.mode != "OFFBOARD" or not self.armed or message.get_type() == "SET_ATTITUDE_TARGET":
            return
        wanted = Setpoint.of(message, self)
        if wanted is None:
            return
        if message.get_type().endswith("LOCAL_NED") and wanted.frame not in (LOCAL_NED, BODY_NED):
            return
        yaw, rate = known(wanted.yaw), known(wanted.yaw_rate)
        if any(math.isfinite(x) for x in wanted.position):
            here = self.guidance.target or self.body.position
            north, east, down = (
                x if math.isfinite(x) else held for x, held in zip(wanted.position, here, strict=True)
            )
            self.guidance.goto((north, east, down), yaw, rate)
        elif any(math.isfinite(x) for x in wanted.velocity):
            north, east, down = (x if math.isfinite(x) else 0.0 for x in wanted.velocity)
            self.guidance.drive((north, east, down), yaw, rate)

    def heard_heartbeat(self, message: Message) -> None:
        """Any ground station counts."""
        if message.type == 6:
            self.failsafes.heard_station()
            self._station = self.now

    def say(self, severity: int, text: str) -> None:
        """Only to a ground station: a companion computer alone on a link gets no texts."""
        if self.now - self._station <= STATION:
            super().say(severity, text)

    # --- every tick ---

    def fly(self) -> None:
        p, guidance = self.parameters, self.guidance
        auto = self.mode in ("HOLD", "MISSION", "RTL", "TAKEOFF", "LAND")
        level = self._cruise if auto else p["MPC_XY_VEL_MAX"]
        up = p["MPC_TKO_SPEED"] if self.mode == "TAKEOFF" else p["MPC_Z_VEL_MAX_UP"]
        guidance.limits = Limits(max(level, 0.2), up, p["MPC_Z_VEL_MAX_DN"])
        guidance.land_speed = p["MPC_LAND_SPEED"]
        guidance.faces_way = auto
        if not self.armed:
            return
        self._flown |= not self.body.on_ground
        if self.mode == "MISSION" and self.mission.tick(TICK):
            self._hold_at_target()
        if self.mode == "TAKEOFF" and not self.body.on_ground and guidance.near_target():
            self._hold_at_target()
        self.failsafes.check()
        self._rest_disarmed()

    def _hold_at_target(self) -> None:
        """HOLD where it was going to, not where it happens to be."""
        target = self.guidance.target
        self.set_mode("HOLD")
        if target is not None and not self.body.on_ground:
            self.guidance.goto(target)

    def stream_trouble(self) -> bool:
        """Whether the setpoints are too few for OFFBOARD: none lately, or not for long enough before."""
        stream = self._stream
        if stream is None or self.now - stream[1] > self.parameters["COM_OF_LOSS_T"]:
            return True
        return stream[1] - stream[0] < self.settings.warm_up

    def _rest_disarmed(self) -> None:
        if not self.body.on_ground:
            self.armed_at = self.now
            return
        if self.mode in ("TAKEOFF", "OFFBOARD", "MISSION") and self.guidance.target is not None:
            return
        delay = self.parameters["COM_DISARM_LAND" if self._flown else "COM_DISARM_PRFLT"]
        if delay > 0 and self.now - self.armed_at > delay:
            self.say(INFO, "Disarmed by landing" if self._flown else "Disarmed by auto preflight disarming")
            self.disarm()
