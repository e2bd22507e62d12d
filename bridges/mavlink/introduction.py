"""Getting to know a vehicle and keeping it talking: version, streams, parameters, failsafes, checks."""

from bridges.mavlink.autopilot import Autopilot, Failsafe, interval, request
from bridges.mavlink.commands import Command, Commands
from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.parameters import Parameters
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.safety import unreliable
from bridges.mavlink.vehicle_state import VehicleReport

ASK_AGAIN = 5.0  # s between reminders of streams that do not come
CHECK_AGAIN = 15.0  # s between questions what fails before arming
BYTEWISE = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE


class Introduction:
    """What is asked of one vehicle besides flying."""

    def __init__(
        self, config: PilotConfig, autopilot: Autopilot, commands: Commands, us: tuple[int, int]
    ) -> None:
        self._config = config
        self._autopilot = autopilot
        self._commands = commands
        self._us = us
        self.parameters = Parameters(commands.system)
        self.failsafes: tuple[Failsafe, ...] = ()
        self.done = False  # it has said what it is and what it does by itself
        self._reminded = -ASK_AGAIN
        self._asked_why = -CHECK_AGAIN
        self._asked_parameters = False
        self._rates_unknown = True  # streams may come faster or slower than asked for

    def __repr__(self) -> str:
        return f"Introduction(done={self.done}, {self.parameters!r})"

    def remind(self) -> None:
        """Ask for everything again that does not come: it has started anew, or was away."""
        self._reminded = -ASK_AGAIN
        self._rates_unknown = True

    def hear(self, message: Message, vehicle: VehicleReport) -> None:
        """Take in a PARAM_VALUE."""
        self.parameters.hear(message, bool((vehicle.capabilities or 0) & BYTEWISE))

    def step(self, now: float, vehicle: VehicleReport) -> list[Message]:
        """Ask for what should come and does not."""
        if now - self._reminded >= ASK_AGAIN and not self._commands.pending(
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        ):
            self._reminded = now
            self._ask(now, vehicle)
        if vehicle.capabilities is not None and not self._asked_parameters:
            self._asked_parameters = True
            self.parameters.read(self._autopilot.parameters)
        elif self._asked_parameters and not self.done and self.parameters.done:
            self.done = True
            self.failsafes = tuple(self._autopilot.failsafes(self.parameters.values, self._us[0]))
        failing = self.done and vehicle.prearm_ok is False and not vehicle.armed
        if failing and self._autopilot.name == "ArduPilot" and now - self._asked_why >= CHECK_AGAIN:
            self._asked_why = now
            self._commands.ask(Command(mavlink.MAV_CMD_RUN_PREARM_CHECKS, "run the pre-arm checks"))
        return self.parameters.step(now)

    def reasons(self, now: float, vehicle: VehicleReport) -> list[str]:
        """Why it may not be armed, a sentence each."""
        if not self.done:
            return ["it has not yet said what it is and what its failsafes are"]
        found = [*self._autopilot.not_ready(vehicle, now), *unreliable(self._config, self.failsafes)]
        low = self._config.fallbacks.low_battery
        if vehicle.battery is not None and vehicle.battery <= low:
            found.append(f"battery at {vehicle.battery:.0%}, not above {low:.0%}")
        if self._config.breach is not None and vehicle.position is not None:
            breach = self._config.breach(vehicle.position)
            if breach is not None:
                found.append(f"where it stands: {breach}")
        return found

    def _ask(self, now: float, vehicle: VehicleReport) -> None:
        if vehicle.capabilities is None:
            self._commands.ask(request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION), urgent=True)
        everything, self._rates_unknown = self._rates_unknown, False
        for message, rate in self._autopilot.streams(self._config.rate):
            if everything or vehicle.age(mavlink.mavlink_map[message].msgname, now) > max(3.0, 3 / rate):
                self._commands.ask(interval(message, rate))
        if vehicle.home is None:
            self._commands.ask(request(mavlink.MAVLINK_MSG_ID_HOME_POSITION))
        if vehicle.origin is None:
            self._commands.ask(request(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN))
