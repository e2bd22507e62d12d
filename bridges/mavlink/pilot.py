"""Everything that is between a robot's wish and its vehicle, without a clock, a thread or a socket.

`step(now, received, wanted)` takes in what came over the link and says what to send. First the vehicle is
found and asked what it is, can do and does by itself; it is flown when nothing speaks against it.
"""

from collections import deque
from typing import Protocol

from bridges.mavlink.autopilot import Autopilot, autopilot_of
from bridges.mavlink.commands import Commands
from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.event import Event
from bridges.mavlink.flight import Flight
from bridges.mavlink.following import WayFlight
from bridges.mavlink.identity import Identity
from bridges.mavlink.introduction import Introduction
from bridges.mavlink.mission_protocol import keeps_home_first
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.port import LinkState
from bridges.mavlink.safety import Reserve
from bridges.mavlink.timesync import TimeSync
from bridges.mavlink.vehicle_state import VehicleReport
from bridges.mavlink.wanted import Drive, GoTo, Hold, Land, TakeOff, Wanted, Way
from bridges.mavlink.ways import Ways

LOST = 4.5  # s without a heartbeat
TURNS, TURN_TIME = 3, 10.0  # so often the clock goes back within s where two vehicles share an id
ONE_REBOOT = 10.0  # s within which all signs are of the same
EVENTS = 200


class Errand(Protocol):
    """A conversation beside flying (mission or fence upload), pure like the pilot."""

    @property
    def done(self) -> bool:
        """Whether it has ended, well or not."""

    def step(self, now: float, received: list[Message]) -> list[Message]:
        """What to send now; `received` is what the vehicle said since the last step."""


class Pilot:
    """One vehicle's. Pure: the same steps give the same messages."""

    def __init__(self, config: PilotConfig) -> None:
        self.config = config
        self.identity = Identity(config)
        self.vehicle = VehicleReport()
        self.autopilot: Autopilot | None = None
        self.flight: Flight | None = None
        self.commands = Commands(0)
        self.timesync = TimeSync(0)
        self.introduction: Introduction | None = None
        self.reserve = Reserve(config, self.say)
        self.events: deque[Event] = deque(maxlen=EVENTS)
        self.phase = "connecting"
        self.trouble = ""
        self.reasons: list[str] = []
        self.captured: float | None = None  # when position and velocity were true, on our clock
        self.link = LinkState()
        self._now = 0.0
        self._reboots = 0  # signs of one
        self._rebooted = -ONE_REBOOT
        self._errands: list[Errand] = []
        self._landed_for = ""  # what was found to be wrong in the air

    def __repr__(self) -> str:
        return f"Pilot({self.phase!r}, {self.trouble!r})"

    @property
    def us(self) -> tuple[int, int]:
        """System and component id to send as."""
        return self.identity.us

    def say(self, level: str, text: str) -> None:
        """An event for people."""
        self.events.append(Event(self._now, level, text))

    def run(self, errand: Errand) -> None:
        """Do this as soon as the vehicle is there."""
        self._errands.append(errand)

    def resume(self, now: float) -> None:
        """The explicit act after a take-over, a lasting fallback or too many refusals."""
        self._now = now
        self.reserve.forget()
        if self.flight is not None:
            self.flight.resume(now)

    def step(
        self,
        now: float,
        received: list[Message],
        wanted: Wanted,
        robot_age: float = 0.0,
        link: LinkState | None = None,
    ) -> list[Message]:
        """What to send now. `robot_age` is how long ago the robot last looked after its vehicle."""
        self._now = now
        self.link = link or LinkState()
        mine = [message for message in received if self.identity.ours(now, message)]
        self.identity.settle(now)
        out = self.identity.heartbeat(now, self._state())
        for message in mine:
            out += self._hear(now, message)
        if not self.identity.found or "HEARTBEAT" not in self.vehicle.heard:
            self._go("connecting", self.identity.absent(self.link))
            return out
        self._notice_reboot(now)
        wrong = self._wrong(now)
        if wrong is not None and (self.flight is None or not self.flight.ours):
            self._go("refused", wrong)
            return out
        if self.vehicle.age("HEARTBEAT", now) > LOST:
            self._lose(now)
            return out
        if self.introduction is None or self.flight is None:
            self.introduction, self.flight = self._introduce()
        out += self._ask(now, self.introduction)
        if wrong is not None:  # found out in the air: what is flown is brought down, not left there
            wanted, self.flight.grounded = Wanted(Land(), wanted.team_age), True
        out += self._fly(now, wanted, robot_age, self.introduction, self.flight)
        if wrong is not None:
            if wrong != self._landed_for:
                self._landed_for = wrong
                self.say("error", f"{wrong}; it is landed")
            self.trouble = wrong
        sent, ended = self.commands.step(now, [(text.time, text.text) for text in self.vehicle.texts])
        for outcome in ended:
            self.flight.outcome(now, outcome)
        for errand in self._errands:
            out += errand.step(now, mine)
        self._errands = [errand for errand in self._errands if not errand.done]
        return out + sent + self.timesync.step(now)

    # -- hearing

    def _hear(self, now: float, message: Message) -> list[Message]:
        told = self.vehicle.told
        self.vehicle.hear(now, message)
        for text in list(self.vehicle.texts)[told - self.vehicle.told :] if self.vehicle.told > told else ():
            if text.severity <= mavlink.MAV_SEVERITY_WARNING:
                self.say("error" if text.severity <= mavlink.MAV_SEVERITY_ERROR else "warning", text.text)
        kind = message.get_type()
        if kind == "LOCAL_POSITION_NED" and self.vehicle.heard.get(kind) == now:
            self.captured = self.timesync.captured(message.time_boot_ms / 1e3, now)
        elif kind == "TIMESYNC":
            return self.timesync.hear(now, message)
        elif kind == "COMMAND_ACK":
            outcome = self.commands.hear(now, message, self.us)
            if outcome is not None and self.flight is not None:
                self.flight.outcome(now, outcome)
        elif kind == "PARAM_VALUE" and self.introduction is not None:
            self.introduction.hear(message, self.vehicle)
        return []

    def _notice_reboot(self, now: float) -> None:
        signs = self.vehicle.reboots + self.timesync.jumps
        if signs == self._reboots:
            return
        self._reboots = signs
        self.timesync.reset()
        if self.introduction is not None:
            self.introduction.remind()
        self.vehicle.home = self.vehicle.origin = None
        self.vehicle.estimator_flags = None
        if now - self._rebooted > ONE_REBOOT:  # its messages show it one after the other
            self.say("warning", f"system {self.identity.system} has started anew")
        self._rebooted = now

    def _wrong(self, now: float) -> str | None:
        turns = [turn for turn in self.vehicle.turns if now - turn < TURN_TIME]
        if len(turns) >= TURNS:
            return self.identity.doubled()
        known = autopilot_of(self.vehicle) is not None
        return self.identity.wrong(self.vehicle, self.link, known)

    # -- phases

    def _go(self, phase: str, trouble: str) -> None:
        if trouble and (phase, trouble) != (self.phase, self.trouble) and phase == "refused":
            self.say("error", trouble)
        self.phase, self.trouble = phase, trouble

    def _lose(self, now: float) -> None:
        """Nothing is sent but our heartbeat: the autopilot must notice that it is alone."""
        if self.phase != "lost":
            text = f"no heartbeat from system {self.identity.system} for {LOST:g} s"
            self.say("error", f"{text}; its own failsafes decide now")
            self.commands.forget()
            self._go("lost", text)
            if self.introduction is not None:
                self.introduction.remind()

    def _introduce(self) -> tuple[Introduction, Flight]:
        self.autopilot = autopilot = autopilot_of(self.vehicle)
        system = self.identity.system
        assert autopilot is not None
        assert system is not None
        self.commands, self.timesync = Commands(system), TimeSync(system)
        ways = Ways((system, 1), self.us, keeps_home_first(autopilot.name))
        flight = WayFlight(self.config, autopilot, self.commands, self.say, ways)
        self._errands.append(ways)
        self.say("info", f"system {system} is a {self.vehicle.body} with {autopilot.name}")
        if self.vehicle.armed and self.config.take_flying:
            flight.take()
        elif self.vehicle.armed:
            flight.found_flying(self._now, autopilot.mode(self.vehicle))
        return Introduction(self.config, autopilot, self.commands, self.us), flight

    def _ask(self, now: float, introduction: Introduction) -> list[Message]:
        before = introduction.done
        out = introduction.step(now, self.vehicle)
        if introduction.done and not before:
            for one in introduction.failsafes:
                self.say("warning" if one.action == "none" else "info", f"{one.cause}: {one.words}")
        return out

    def _fly(
        self, now: float, wanted: Wanted, robot_age: float, introduction: Introduction, flight: Flight
    ) -> list[Message]:
        grounded = flight.phase in ("ready", "engaging")
        self.reasons = introduction.reasons(now, self.vehicle) if grounded else []
        if grounded and robot_age > self.config.fallbacks.robot_silent_s:
            self.reasons.append("the robot is silent")
        if not self.config.fly:
            self._go("ready" if introduction.done else "introducing", "")
            return []
        task = wanted.task
        if flight.ours:
            task = self.reserve.task(now, self.vehicle, wanted, robot_age)
            if flight.phase == "following" and isinstance(task, Hold):
                task = wanted.task  # what is followed without us needs no link, and holding needs one
            flight.grounded |= self.reserve.grounds
        out = flight.step(now, self.vehicle, task, self.reasons)
        trouble = flight.trouble
        if flight.phase == "ready" and self.reasons and isinstance(wanted.task, GoTo | Drive | TakeOff | Way):
            trouble = self.reasons[0]
        self._go(flight.phase if introduction.done or flight.phase != "ready" else "introducing", trouble)
        return out

    def _state(self) -> int:
        """What our own heartbeat says of us."""
        if self.reserve.now is not None or self.phase in ("lost", "refused"):
            return int(mavlink.MAV_STATE_CRITICAL)
        ours = self.flight is not None and self.flight.ours
        return int(mavlink.MAV_STATE_ACTIVE if ours else mavlink.MAV_STATE_STANDBY)
