"""`kind = "mavlink"`: a robot that flies, or drives, a real autopilot.

What planners predict with is the point mass, or the unicycle for a rover, within the limits of the table. In
virtual time (`searchparty simulate`, campaigns) there is no autopilot: that same model moves, as a rehearsal.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta

from agents import plugins
from agents.devices import DeviceContext, LiveVehicle, Vehicle
from agents.errors import MissionError
from bridges.mavlink.url import parse_url
from estimator.arrays import NonNegative, Positive
from estimator.filter import Area
from planner.plan import VehicleModel
from planner.vehicles.point_mass import PointMass, PointMassConfig
from planner.vehicles.power import Power
from planner.vehicles.unicycle import Unicycle, UnicycleConfig

if TYPE_CHECKING:
    from bridges.mavlink.pilot_config import PilotConfig
    from bridges.mavlink.wanted import Permit

Action = Literal["continue", "hold", "land", "return"]
Cause = Literal["ground link", "setpoints", "low battery", "estimator", "fence", "radio control"]
Share = Annotated[float, Meta(ge=0, lt=1)]
SystemId = Annotated[int, Meta(ge=1, le=254)]


class MavlinkConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a mission says of a vehicle with an autopilot."""

    url: str  # udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:DEVICE:BAUD
    autopilot: Literal["auto", "ardupilot", "px4"] = "auto"
    body: Literal["copter", "rover"] = "copter"  # another one at the URL is refused
    system_id: SystemId = 1  # of the vehicle
    companion_system_id: SystemId | None = None  # ours; left out: the vehicle's
    companion_component_id: Annotated[int, Meta(ge=1, le=255)] = 191  # ours: an onboard computer
    signing_key: Path | None = None  # file of the key with which both sides sign; left out: unsigned
    speed_m_s: Positive = 5.0  # as the autopilot's parameters allow
    acceleration_m_s2: Positive = 2.0
    turn_rate_deg_s: Positive = 60.0  # of a rover
    tolerance_m: Positive = 0.8  # nearer than this counts as there
    take_off_m: Positive = 5.0  # above the ground; from there it climbs to its start's altitude
    altitude: Literal["home", "origin"] = "home"  # where z = 0 is: the vehicle's home, or origin.altitude
    altitude_m: tuple[float, float] = (1.0, 120.0)  # between which a copter stays
    margin_m: NonNegative = 10.0  # beyond the mission's area to which it may be sent
    start_within_m: Positive = 10.0  # of its start in the mission it must stand
    ready_after_s: Positive = 25.0  # it is refused if it may not be armed by then
    ways: Literal["setpoints", "mission"] = "setpoints"  # "mission": put on board, and flown from there
    at_end: Literal["return", "land"] = "return"  # when its robot ends
    take_flying: bool = False  # also take one that flies when it is found
    low_battery: Share = 0.2  # of its charge
    on_low_battery: Action = "return"
    pose_stale_s: Positive = 1.5
    on_pose_stale: Action = "hold"
    team_lost_s: Positive = 10.0  # nothing was heard of any other process
    on_team_lost: Action = "hold"
    robot_silent_s: Positive = 3.0  # its robot's loop hangs
    on_robot_silent: Action = "return"
    on_outside: Action = "return"  # out of bounds by more than margin_m
    failsafes: dict[str, str] = {}  # cause -> action that the autopilot's own parameters must say
    power: Power = Power(rest_w=150.0, metre_j=0.0, climb_j_m=9.8)

    def __post_init__(self) -> None:
        try:
            parse_url(self.url)
        except MissionError as error:
            raise ValueError(str(error)) from None
        if not self.altitude_m[0] < self.altitude_m[1]:
            raise ValueError(f"altitude_m: two numbers, the first below the second; found {self.altitude_m}")
        for cause in self.failsafes:
            if cause not in get_args(Cause):
                raise ValueError(f'failsafes: "{cause}" is none of {", ".join(get_args(Cause))}')

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest altitude, m; a rover goes as the ground goes."""
        return self.altitude_m if self.body == "copter" else (-1e4, 1e4)

    def prediction(self) -> PointMassConfig | UnicycleConfig:
        """What is predicted of it."""
        speed, acceleration = self.speed_m_s, self.acceleration_m_s2
        if self.body == "copter":
            return PointMassConfig(
                speed_m_s=speed,
                acceleration_m_s2=acceleration,
                tolerance_m=self.tolerance_m,
                power=self.power,
            )
        return UnicycleConfig(
            speed_m_s=speed,
            acceleration_m_s2=acceleration,
            turn_rate_deg_s=self.turn_rate_deg_s,
            tolerance_m=self.tolerance_m,
            power=self.power,
        )

    def pilot(self, permit: "Permit", breach: "Permit") -> "PilotConfig":
        """The part of the table that concerns the pilot; it asks `permit` and `breach` for the fence."""
        from bridges.mavlink.pilot_config import Fallbacks, PilotConfig  # noqa: PLC0415

        return PilotConfig(
            system=self.system_id,
            source_system=self.companion_system_id,
            source_component=self.companion_component_id,
            autopilot=self.autopilot,
            body=self.body,
            take_off_height=self.take_off_m,
            take_flying=self.take_flying,
            fallbacks=Fallbacks(
                low_battery=self.low_battery,
                on_low_battery=self.on_low_battery,
                pose_stale_s=self.pose_stale_s,
                on_pose_stale=self.on_pose_stale,
                team_lost_s=self.team_lost_s,
                on_team_lost=self.on_team_lost,
                robot_silent_s=self.robot_silent_s,
                on_robot_silent=self.on_robot_silent,
                on_outside=self.on_outside,
            ),
            failsafes=dict(self.failsafes),
            permit=permit,
            breach=breach,
            url=self.url,
        )


class MavlinkKind:
    """A vehicle behind a MAVLink address."""

    Config = MavlinkConfig

    @staticmethod
    def model(config: Any, area: Area) -> VehicleModel:
        if config.body == "rover":
            return Unicycle(config.prediction())
        return PointMass(config.prediction())

    @staticmethod
    def device(config: Any, context: DeviceContext) -> Vehicle:
        """The rehearsal: a simulated vehicle that moves as is predicted of the real one."""
        kind = plugins.load("vehicles", "unicycle" if config.body == "rover" else "point_mass")
        made: Vehicle = kind.device(config.prediction(), context)
        return made

    @staticmethod
    def connect(config: Any, context: DeviceContext) -> LiveVehicle:
        """The vehicle itself, looked for by a thread."""
        from bridges.mavlink.device import MavlinkVehicle  # noqa: PLC0415 - pymavlink takes its time

        return MavlinkVehicle(config, MavlinkKind.model(config, context.area), context)
