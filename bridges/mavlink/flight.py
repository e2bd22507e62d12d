"""From a vehicle on the ground to one that follows setpoints, and back: the part of the pilot that flies.

Phases: "ready" (on the ground, not ours), "engaging" (setpoints stream, the mode is asked for, then arming),
"climbing", "flying", "landing", "returning", and "taken over": somebody else flies, until `resume`.

Nothing is believed because it was acknowledged: the mode and arming are read from heartbeats. A mode that we
have not asked for ends our control at once, whoever asked for it: setpoints and commands stop with that step.
"""

from collections.abc import Callable

import numpy as np

from bridges.mavlink.autopilot import Autopilot, arm
from bridges.mavlink.commands import Commands, Outcome
from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.safety import forbidden
from bridges.mavlink.setpoints import Setpoints
from bridges.mavlink.takeover import UNTIL, taken_by, who
from bridges.mavlink.vehicle_state import VehicleReport
from bridges.mavlink.wanted import Drive, GoTo, Hold, Land, Rest, Return, TakeOff, Task
from estimator.arrays import FloatArray

MODE_PATIENCE = 6.0  # s for a mode or arming to show in heartbeats
CLIMB_PATIENCE = 45.0
AGAIN = 5.0  # s before a refused start is tried again
STARTS = 4  # tries before a person must look
STANDS, STOOD = 0.1, 3.0  # m/s and s: a rover so slow for so long has come to a stop
CLIMBED = 0.5  # m below the take-off height that are high enough
OURS = frozenset({"climbing", "flying", "landing", "returning"})
Say = Callable[[str, str], None]


class Flight:
    """Pure: what comes in are times, the vehicle's report and the task; what goes out are messages."""

    def __init__(self, config: PilotConfig, autopilot: Autopilot, commands: Commands, say: Say) -> None:
        self._config = config
        self.autopilot = autopilot
        self._commands = commands
        self._say = say
        self.phase = "ready"
        self.trouble = ""
        self._began = 0.0  # when this phase did
        self._asked: dict[str, float] = {}  # what was asked for in this phase, and when
        self._starts = 0
        self._not_before = 0.0
        self._base: FloatArray | None = None  # where it took off
        self._mode_before = ""
        self._setpoints = Setpoints((commands.system, commands.component), config.fallbacks.pose_stale_s)
        self.grounded = False  # it comes down and stays there until resumed
        self._refused = ""  # the setpoint that was not sent, once said
        self._rising = False  # it has left the ground to climb
        self._taking = False  # whoever flew it before, we were told to take it

    def __repr__(self) -> str:
        return f"Flight({self.phase!r}, {self.trouble!r})"

    @property
    def ours(self) -> bool:
        return self.phase in OURS

    def found_flying(self, now: float, mode: str) -> None:
        """It was armed before we came."""
        self._enter("taken over", now)
        self.trouble = f"it was already armed in mode {mode} when found; {UNTIL}"
        self._say("warning", self.trouble)

    def resume(self, now: float) -> None:
        """The explicit act after which we may fly it again."""
        self._starts, self._not_before, self.grounded = 0, now, False
        self.trouble, self._refused = "", ""
        if self.phase == "taken over":
            self._taking = True
            self._enter("ready", now)
            self._say("info", "control is taken again, as asked")

    def take(self) -> None:
        """Whoever armed it, it is ours from here."""
        self._taking = True

    def take_over(self, now: float, why: str) -> None:
        """Let go of it, at once."""
        self._enter("taken over", now)
        self._commands.forget()
        self._taking = False
        self.trouble = why
        self._say("warning", why)

    def outcome(self, now: float, outcome: Outcome) -> None:
        """How a command of ours ended."""
        if outcome.ok or (self._rising and outcome.command.number == mavlink.MAV_CMD_NAV_TAKEOFF):
            return  # asked again for want of an answer, an ArduPilot in the air refuses to take off
        if outcome.command.number in (
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
            mavlink.MAV_CMD_DO_SET_MODE,
            mavlink.MAV_CMD_NAV_TAKEOFF,
        ):
            self._say("error", outcome.words)
            self.trouble = outcome.words
            if self.phase in ("engaging", "climbing") and outcome.command.what != "disarm":
                self._fail(now, outcome.words)
            else:
                self._asked.pop(outcome.command.what, None)  # landing and returning are asked for again

    def step(self, now: float, report: VehicleReport, task: Task, reasons: list[str]) -> list[Message]:
        """What to send now. `reasons` say why it may not be armed."""
        taken = taken_by(self.phase, "there" in self._asked, self.autopilot, report, now)
        if taken is not None:
            self.take_over(now, taken)
        if self.phase == "taken over":
            return []
        self._rising = self.phase == "climbing" and report.in_air
        if self.phase in ("ready", "engaging"):
            begin = self._ready if self.phase == "ready" else self._engaging
            return begin(now, report, task, reasons)
        go_on = {"climbing": self._climbing, "flying": self._flying}.get(self.phase, self._down)
        return go_on(now, report, task)

    def _ready(self, now: float, report: VehicleReport, task: Task, reasons: list[str]) -> list[Message]:
        flying = report.armed and report.in_air
        if flying and ("disarm" in self._asked or self.grounded):  # in the air it would not be disarmed
            self._enter("landing", now)
            return self._down(now, report, task)
        if report.armed and not self._taking:
            if "disarm" not in self._asked:
                self.found_flying(now, self.autopilot.mode(report))
            return []
        if flying and isinstance(task, Land | Return):
            self._enter("landing" if isinstance(task, Land) else "returning", now)
            return self._down(now, report, task)
        wants = flying or isinstance(task, GoTo | Drive | TakeOff)
        if not wants or self.grounded or now < self._not_before or self._starts >= STARTS:
            return []
        if reasons and not flying:
            return []
        refused = forbidden(self._config, report, task)
        if refused is not None and not flying:
            self._refuse(refused)
            return []
        self._starts += 1
        self._base = None if report.position is None else report.position.copy()
        self._setpoints.let_go()
        self._mode_before = self.autopilot.mode(report)
        self._enter("engaging", now)
        return self._engaging(now, report, task, reasons)

    def _engaging(self, now: float, report: VehicleReport, task: Task, reasons: list[str]) -> list[Message]:
        flying = report.armed and report.in_air
        if not flying and (reasons or isinstance(task, Rest | Hold | Land | Return)):
            self._fail(now, reasons[0] if reasons else "it is not wanted any more", tried=False)
            return []
        out = self._setpoints.hold(now, report) if self.autopilot.climbs_by_setpoint or flying else []
        if now - self._began < self.autopilot.lead:
            return out
        guided = self.autopilot.guided
        if self.autopilot.mode(report) != guided:
            mode = self.autopilot.mode(report)
            if "guided" in self._asked or mode != self._mode_before:
                self.take_over(now, who(report, mode, now))
                return []
            self._ask_mode(now, guided)
            return out
        self._asked.setdefault("guided", now)
        if not report.armed:
            if "armed" in self._asked:
                self._fail(now, "it disarmed again before it took off")
            else:
                self._ask(now, "arm", lambda: self._commands.ask(arm(True), urgent=True))
            return out
        self._asked.setdefault("armed", now)
        self._taking = False
        if flying or self.autopilot.body != "copter":
            self._starts = 0
            self._enter("flying", now)
            self.trouble = ""
        else:
            self._enter("climbing", now)
        return out

    def _climbing(self, now: float, report: VehicleReport, task: Task) -> list[Message]:
        if self._climbed(report):
            self._starts, self.trouble = 0, ""
            self._setpoints.let_go()
            self._enter("flying", now)
            return self._flying(now, report, task)
        if isinstance(task, Land | Return):
            self._enter("landing", now)
            return self._down(now, report, task)
        out, height = [], self._config.take_off_height
        command = self.autopilot.take_off(height)
        if command is None:
            assert self._base is not None
            out = self._setpoints.position(now, self._base - np.array([0.0, 0.0, height]), None)
        elif "take off" not in self._asked:
            self._asked["take off"] = now
            self._commands.ask(command, urgent=True)
        if now - self._began > CLIMB_PATIENCE:
            self._say("error", f"it did not climb to {height:g} m within {CLIMB_PATIENCE:g} s; it lands")
            self.trouble, self.grounded = "it did not climb", True
            self._enter("landing", now)
        return out

    def _climbed(self, report: VehicleReport) -> bool:
        if report.position is None or self._base is None:
            return False
        height = self._config.take_off_height
        return bool(self._base[2] - report.position[2] >= height - max(CLIMBED, 0.1 * height))

    def _flying(self, now: float, report: VehicleReport, task: Task) -> list[Message]:
        if isinstance(task, Land | Return):
            self._enter("landing" if isinstance(task, Land) else "returning", now)
            return self._down(now, report, task)
        refused = forbidden(self._config, report, task)
        if refused is not None:
            self._refuse(refused)
            return self._setpoints.hold(now, report)
        if isinstance(task, GoTo):
            self._permitted()
            return self._setpoints.position(now, task.position, task.yaw)
        if isinstance(task, Drive):
            self._permitted()
            yaw = task.yaw if self.autopilot.body == "copter" else None  # a rover would drive where it looks
            return self._setpoints.velocity(now, task.velocity, yaw)
        return self._setpoints.hold(now, report)

    def _down(self, now: float, report: VehicleReport, task: Task) -> list[Message]:
        """Landing or returning: the autopilot's own mode does it; until it is there, setpoints go on."""
        if not report.armed:
            stands = "has landed" if self.autopilot.body == "copter" else "stands"
            self._say("info", f"it {stands} and is disarmed")
            self._enter("ready", now)
            return []
        if isinstance(task, Land) and self.phase == "returning":
            self._enter("landing", now)
        if self.phase == "landing" and isinstance(task, Return) and self.trouble == "":
            self._enter("returning", now)
        mode = self.autopilot.land_mode if self.phase == "landing" else self.autopilot.return_mode
        if self.autopilot.mode(report) != mode:
            self._ask_mode(now, mode)
            guided = self.autopilot.mode(report) == self.autopilot.guided
            return self._setpoints.hold(now, report) if guided else []
        self._asked.setdefault("there", now)
        if report.velocity is None or float(np.linalg.norm(report.velocity)) > STANDS:
            self._asked["there"] = now  # still on its way
        if self.autopilot.body == "rover" and now - self._asked["there"] > STOOD:
            self._ask(now, "disarm", lambda: self._commands.ask(arm(False)))
        elif isinstance(task, GoTo | Drive | Hold | TakeOff) and report.in_air and not self.grounded:
            self._taking = True  # our own landing, called off
            self._starts = 0
            self._setpoints.let_go()
            self._mode_before = self.autopilot.mode(report)
            self._enter("engaging", now)
        return []

    def _fail(self, now: float, why: str, tried: bool = True) -> None:
        self.trouble = why
        if not tried:
            self._starts -= 1
        if "armed" in self._asked or self.phase == "climbing":
            self._commands.ask(arm(False), urgent=True)  # refused by the autopilot when it flies after all
            self._enter("ready", now)
            self._asked["disarm"] = now
        else:
            self._enter("ready", now)
        self._not_before = now + AGAIN
        if self._starts >= STARTS:
            self._say("error", f"it was not started after {STARTS} tries ({why}); resume it to try again")

    def _permitted(self) -> None:
        self._setpoints.let_go()
        if self._refused:
            self._refused = self.trouble = ""

    def _refuse(self, why: str) -> None:
        self.trouble = why
        if why != self._refused:
            self._refused = why
            self._say("error", f"not flown there: {why}")

    def _enter(self, phase: str, now: float) -> None:
        self.phase, self._began = phase, now
        self._asked = {}

    def _ask_mode(self, now: float, mode: str) -> None:
        command = self.autopilot.mode_command(mode)
        self._ask(now, f"mode {mode}", lambda: self._commands.ask(command, urgent=True))

    def _ask(self, now: float, what: str, send: Callable[[], None]) -> None:
        """Once, and again when it has been acknowledged but does not show."""
        asked = self._asked.get(what)
        if asked is None:
            self._asked[what] = now
            send()
        elif now - asked > MODE_PATIENCE:
            del self._asked[what]
            if self.phase == "engaging":
                self._say("error", f"{what}: acknowledged, but it does not show within {MODE_PATIENCE:g} s")
                self._fail(now, f"{what} does not show")
