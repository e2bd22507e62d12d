"""MAVSDK, which was written for real vehicles, flies the simulated one: neither knows the other."""

import importlib
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from sim.mavlink.serve import Served
from sim.mavlink.settings import Settings

mavsdk = pytest.importorskip("mavsdk", "4.0", reason="mavsdk 4 is not installed: pip install mavsdk")
plugins = {
    name: importlib.import_module(f"mavsdk.plugins.{name}")
    for name in ("action", "info", "mission", "offboard", "param", "telemetry")
}
Action, Info, Param = plugins["action"].Action, plugins["info"].Info, plugins["param"].Param
Telemetry, Offboard, Mission = (
    plugins["telemetry"].Telemetry,
    plugins["offboard"].Offboard,
    plugins["mission"].Mission,
)
MissionItem, MissionPlan = plugins["mission"].MissionItem, plugins["mission"].MissionPlan
PositionNedYaw, VelocityNedYaw = plugins["offboard"].PositionNedYaw, plugins["offboard"].VelocityNedYaw

pytestmark = pytest.mark.processes
SPEED = 5.0
PATIENCE = 20.0  # s of the wall's clock, on a busy machine


def until(condition: Callable[[], Any]) -> bool:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.02)
    return False


class Flight:
    """A vehicle, and MAVSDK connected to it."""

    def __init__(self, vehicle: Served) -> None:
        self.vehicle = vehicle
        ground = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
        self.sdk = mavsdk.Mavsdk(ground)
        self.sdk.add_any_connection(vehicle.url.replace("tcp:", "tcpout://"))
        self.system = self.sdk.first_autopilot(PATIENCE)
        assert self.system is not None
        self.action, self.telemetry = Action(self.system), Telemetry(self.system)

    def position(self) -> tuple[float, float, float]:
        return self.vehicle.ask(lambda autopilot: autopilot.body.position)

    def near(self, place: tuple[float, float, float]) -> bool:
        return until(lambda: math.dist(self.position(), place) < 0.5)

    def mode(self) -> str:
        return self.vehicle.ask(lambda autopilot: autopilot.mode)

    def degrees(self, north: float, east: float) -> tuple[float, float]:
        return self.vehicle.ask(lambda autopilot: autopilot.projection.to_degrees(north, east))

    def take_off(self) -> None:
        for set_rate in ("position", "health", "in_air", "home"):
            getattr(self.telemetry, f"set_rate_{set_rate}")(10.0)
        assert until(self.telemetry.health_all_ok)
        self.action.set_takeoff_altitude(8.0)
        self.action.arm()
        self.action.takeoff()
        assert until(lambda: -self.position()[2] > 7.6)


@pytest.fixture(params=["px4", "ardupilot"])
def flight(request: pytest.FixtureRequest) -> Iterator[Flight]:
    fast = {"MPC_XY_CRUISE": 10.0, "MPC_LAND_SPEED": 1.5} if request.param == "px4" else {"LAND_SPEED": 150.0}
    with Served(Settings(autopilot=request.param, parameters=fast), speed=SPEED) as vehicle:
        made = Flight(vehicle)
        yield made
        made.sdk.destroy()


def test_it_says_who_it_is_and_how_it_is(flight: Flight) -> None:
    info, telemetry = Info(flight.system), flight.telemetry
    version = info.get_version()
    autopilot = flight.vehicle.ask(lambda pilot: pilot.settings.autopilot)
    assert (version.flight_sw_major, version.flight_sw_minor) == ((1, 16) if autopilot == "px4" else (4, 6))
    for name in ("position", "battery", "home", "gps_info", "health", "attitude_euler"):
        getattr(telemetry, f"set_rate_{name}")(10.0)
    assert until(telemetry.health_all_ok)
    assert until(lambda: telemetry.position().latitude_deg == pytest.approx(47.397742, abs=1e-6))
    assert until(lambda: telemetry.battery().remaining_percent == 100.0)
    assert telemetry.home().absolute_altitude_m == pytest.approx(488.0, abs=0.01)
    assert until(lambda: telemetry.gps_info().num_satellites == 10)
    parameters = Param(flight.system)
    name = "MPC_XY_VEL_MAX" if autopilot == "px4" else "WPNAV_SPEED"
    parameters.set_param_float(name, 7.5)
    assert parameters.get_param_float(name) == 7.5
    whole = "COM_DL_LOSS_T" if autopilot == "px4" else "FS_OPTIONS"
    assert parameters.get_param_int(whole) == (10 if autopilot == "px4" else 16)


def test_it_takes_off_goes_returns_and_lands(flight: Flight) -> None:
    flight.take_off()
    assert until(flight.telemetry.in_air)
    assert flight.telemetry.armed()
    flight.action.goto_location(*flight.degrees(20.0, 10.0), 500.0, 0.0)
    assert flight.near((20.0, 10.0, -12.0))
    flight.action.return_to_launch()
    assert until(lambda: flight.mode() == "RTL")
    flight.action.land()
    assert until(lambda: flight.mode() == "LAND")
    assert until(lambda: not flight.telemetry.armed())


def test_it_flies_offboard(flight: Flight) -> None:
    flight.take_off()
    offboard = Offboard(flight.system)
    offboard.set_position_ned(PositionNedYaw(10.0, 0.0, -10.0, 0.0))
    time.sleep(1.0)  # a PX4 wants to have heard setpoints for a while
    offboard.start()
    assert flight.near((10.0, 0.0, -10.0))
    assert flight.mode() in ("OFFBOARD", "GUIDED")
    offboard.set_velocity_ned(VelocityNedYaw(0.0, 3.0, 0.0, 0.0))
    assert until(lambda: flight.position()[1] > 5.0)
    offboard.stop()
    assert until(lambda: flight.mode() not in ("OFFBOARD", "GUIDED"))


def test_it_takes_a_mission_and_flies_it(flight: Flight) -> None:
    flight.take_off()
    mission = Mission(flight.system)
    corners = [flight.degrees(10.0, 0.0), flight.degrees(10.0, 10.0)]
    mission.upload_mission(MissionPlan([MissionItem(*corner, 12.0, 8.0, True) for corner in corners]))
    mission.start_mission()
    assert flight.near((10.0, 10.0, -12.0))
    if flight.vehicle.ask(lambda pilot: pilot.settings.autopilot) == "px4":
        back = mission.download_mission().mission_items  # of an ArduPilot's, MAVSDK cannot read the home item
        assert [item.latitude_deg for item in back] == pytest.approx([c[0] for c in corners], abs=1e-6)
