"""What the pilot tells the robot: a snapshot that nobody changes any more, made for another thread."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from bridges.mavlink.autopilot import Failsafe
from bridges.mavlink.pilot import Pilot
from bridges.mavlink.port import LinkState
from bridges.mavlink.vehicle_state import VehicleReport
from estimator.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class PilotReport:
    """The vehicle and the pilot at `time`. Times are of the bridge's clock, positions local NED."""

    time: float
    phase: str = "connecting"  # see flight.Flight; also "connecting", "introducing", "refused", "lost"
    trouble: str = ""  # why it is not found, refused, taken over or does not do what is wanted
    reasons: tuple[str, ...] = ()  # why it may not be armed
    ours: bool = False  # we are in control
    fallback: str = ""  # why it does something else than is wanted
    system: int | None = None
    autopilot: str = ""
    version: str = ""
    body: str = ""
    mode: str = ""
    modes: tuple[str, ...] = ()  # that it may have
    armed: bool = False
    in_air: bool = False
    captured: float | None = None  # when position and velocity were true
    position: FloatArray | None = None  # (3,)
    velocity: FloatArray | None = None  # (3,)
    attitude: tuple[float, float, float] | None = None  # roll, pitch, yaw
    where: tuple[float, float, float] | None = None  # latitude, longitude, altitude AMSL
    home: tuple[float, float, float] | None = None
    origin: tuple[float, float, float] | None = None  # of local NED
    battery: float | None = None  # fraction
    voltage: float | None = None
    estimator_flags: int | None = None
    gps_fix: int | None = None
    satellites: int | None = None
    capabilities: int | None = None
    link_quality: float = 1.0  # share of its messages that arrived, by their numbers
    radio: float | None = None
    clock_offset: float | None = None  # s, the vehicle's clock minus ours
    round_trip: float | None = None  # s
    failsafes: tuple[Failsafe, ...] = ()
    texts: tuple[str, ...] = ()  # status texts of late
    link: LinkState = field(default_factory=LinkState)
    counters: Mapping[str, int] | None = None

    def gauges(self) -> dict[str, float]:
        """Numbers for a health message."""
        found = {
            "mavlink.armed": float(self.armed),
            "mavlink.in_air": float(self.in_air),
            "mavlink.link_quality": self.link_quality,
        }
        for name in ("battery", "voltage", "gps_fix", "satellites", "radio", "round_trip", "clock_offset"):
            value = getattr(self, name)
            if value is not None:
                found[f"mavlink.{name}"] = float(value)
        if self.estimator_flags is not None:
            found["mavlink.estimator_flags"] = float(self.estimator_flags)
        return found


def home_of(vehicle: VehicleReport) -> tuple[float, float, float] | None:
    """Its home; that of a rover is as high as its origin.

    An ArduPilot rover sets its home before its estimator knows its altitude, and keeps that: measured with
    4.6, the home of one that stands 488 m above the sea is at 0.14 m.
    """
    if vehicle.body != "rover" or vehicle.home is None:
        return vehicle.home
    return None if vehicle.origin is None else (*vehicle.home[:2], vehicle.origin[2])


def report_of(now: float, pilot: Pilot, counters: Mapping[str, int]) -> PilotReport:
    """A snapshot of a pilot and its vehicle."""
    vehicle, flight = pilot.vehicle, pilot.flight
    counts = dict(counters)
    counts.update(vehicle.counters)
    system = pilot.identity.system or 0
    arrived, missed = pilot.link.arrived.get(system, 0), pilot.link.missed.get(system, 0)
    counts["missed"] = missed
    counts["resent_commands"] = pilot.commands.resent
    return PilotReport(
        time=now,
        phase=pilot.phase,
        trouble=pilot.trouble,
        reasons=tuple(pilot.reasons),
        ours=flight is not None and flight.ours and pilot.phase != "lost",
        fallback=pilot.reserve.now.reason if pilot.reserve.now else "",
        system=pilot.identity.system,
        autopilot=pilot.autopilot.name if pilot.autopilot else "",
        version=vehicle.version,
        body=vehicle.body if pilot.autopilot else "",
        mode=pilot.autopilot.mode(vehicle) if pilot.autopilot else "",
        modes=pilot.autopilot.modes if pilot.autopilot else (),
        armed=vehicle.armed,
        in_air=vehicle.in_air,
        captured=pilot.captured,
        position=vehicle.position,
        velocity=vehicle.velocity,
        attitude=vehicle.attitude,
        where=vehicle.where,
        home=home_of(vehicle),
        origin=vehicle.origin,
        battery=vehicle.battery,
        voltage=vehicle.voltage,
        estimator_flags=vehicle.estimator_flags,
        gps_fix=vehicle.gps_fix,
        satellites=vehicle.satellites,
        capabilities=vehicle.capabilities,
        link_quality=arrived / (arrived + missed) if arrived else 1.0,
        radio=vehicle.radio,
        clock_offset=pilot.timesync.offset,
        round_trip=pilot.timesync.round_trip,
        failsafes=pilot.introduction.failsafes if pilot.introduction else (),
        texts=tuple(text.text for text in vehicle.texts),
        link=pilot.link,
        counters=counts,
    )
