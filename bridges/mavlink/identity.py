"""Who speaks on the link, which of them is our vehicle, and who we are to them.

Only an autopilot is believed: component 1 with an autopilot that is not INVALID. A ground station, a camera
or another companion may share the link and even the system id.
"""

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.port import LinkState
from bridges.mavlink.vehicle_state import VehicleReport, body_of
from bridges.mavlink.wire import AUTOPILOT

PERIOD = 1.0  # s between our heartbeats
LISTEN = 1.2  # s in which a second vehicle would be heard, when any is welcome
NAMES = {mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: "ardupilot", mavlink.MAV_AUTOPILOT_PX4: "px4"}


def is_autopilot(message: Message) -> bool:
    """Whether a heartbeat is a vehicle's, not a ground station's or a payload's."""
    return (
        message.get_srcComponent() == AUTOPILOT
        and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        and message.type not in (mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
    )


class Identity:
    """Finds the vehicle, and is the companion computer beside it."""

    def __init__(self, config: PilotConfig) -> None:
        self._config = config
        self.system = config.system
        self.found = False
        self.others: dict[int, str] = {}  # vehicles heard that are not ours
        self._candidates: dict[int, tuple[float, int]] = {}  # system -> first heard, MAV_TYPE
        self._stations: set[int] = set()
        self._due = 0.0

    def __repr__(self) -> str:
        return f"Identity(system={self.system}, found={self.found}, others={sorted(self.others)})"

    @property
    def us(self) -> tuple[int, int]:
        """System and component id that we send as."""
        return self._config.source_system or self.system or 1, self._config.source_component

    def ours(self, now: float, message: Message) -> bool:
        """Whether a message is from our vehicle's autopilot."""
        if message.get_type() == "HEARTBEAT":
            self._look(now, message)
        return (
            self.found and message.get_srcSystem() == self.system and message.get_srcComponent() == AUTOPILOT
        )

    def _look(self, now: float, message: Message) -> None:
        system = message.get_srcSystem()
        if not is_autopilot(message):
            if message.type == mavlink.MAV_TYPE_GCS:
                self._stations.add(system)
            return
        self._candidates.setdefault(system, (now, message.type))
        if system == self.system:
            self.found = True
        elif (self._config.system is not None or self.found) and len(self.others) < 255:
            self.others[system] = body_of(message.type)

    def settle(self, now: float) -> None:
        """Choose the only vehicle there, when any is welcome."""
        if self._config.system is None and not self.found and len(self._candidates) == 1:
            ((system, (since, _)),) = self._candidates.items()
            if now - since >= LISTEN:
                self.system, self.found = system, True

    def heartbeat(self, now: float, state: int) -> list[Message]:
        """Ours, once a second."""
        if now < self._due:
            return []
        self._due = now + PERIOD
        return [
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
            )
        ]

    def absent(self, link: LinkState) -> str:
        """Why no vehicle was found so far, in one sentence."""
        url = self._config.url
        if not link.open:
            return f"{url} cannot be opened: {link.trouble}"
        if self.system is None and len(self._candidates) > 1:
            names = ", ".join(f"{s} ({body_of(t)})" for s, (_, t) in sorted(self._candidates.items()))
            return f"several vehicles are at {url}: {names}; say which with system_id"
        wanted = f"system {self.system}" if self.system is not None else "a vehicle"
        if self.system in link.version1 or (self.system is None and link.version1):
            return (
                f"{wanted} speaks only MAVLink 1 at {url}; set its port to MAVLink 2 "
                "(ArduPilot SERIALn_PROTOCOL = 2, PX4 MAV_PROTO_VER = 2)"
            )
        if self.system in link.unsigned or (self.system is None and link.unsigned):
            return f"{wanted} sends at {url}, but unsigned or with another key than ours; compare the keys"
        if self.others:
            names = ", ".join(f"{system} ({body})" for system, body in sorted(self.others.items()))
            return f"{wanted} is not at {url}; vehicles heard there: {names}; correct system_id"
        if self._stations:
            return f"only a ground station (system {min(self._stations)}) is heard at {url}, no vehicle"
        return f"no vehicle is heard at {url}; is it switched on, and does it send there?"

    def doubled(self) -> str:
        """The sentence for two vehicles with one id."""
        return f"two vehicles with system id {self.system} are at {self._config.url}; give each its own"

    def wrong(self, report: VehicleReport, link: LinkState, known: bool) -> str | None:
        """Why the vehicle found may not be flown, in one sentence; None: it is as the mission says."""
        config, body = self._config, report.body
        if self.system in link.doubled:
            return self.doubled()
        if config.body is not None and body != config.body:
            return f"system {self.system} is a {body}, but the mission expects a {config.body}"
        name = NAMES.get(report.autopilot, f"autopilot {report.autopilot}")
        if config.autopilot not in ("auto", name):
            return f"system {self.system} flies with {name}, but the mission expects {config.autopilot}"
        if not known:
            known_ones = "ArduPilot copters and rovers, PX4 copters"
            return f"system {self.system} is a {body} with {name}; only these are flown: {known_ones}"
        if self.system in link.signing and not link.keys:
            return f"system {self.system} signs its messages and would not hear ours; name the key file"
        return None
