"""`searchparty vehicle URL --fence MISSION`: a mission's area and zones become the fence on board."""

import sys
from typing import Any

import numpy as np
import typer

from agents import plugins
from agents.devices import DeviceContext
from agents.errors import LinkError, MissionError
from agents.mission.ground import ground_plan
from agents.mission.mission import Mission, RobotTable, start_pose
from agents.mission.mission_file import load
from agents.mission.tables import convert
from bridges.mavlink.dialect import mavlink
from bridges.mavlink.frames import TeamFrame
from bridges.mavlink.geofence import Fence, box_shape, fence_items
from bridges.mavlink.kind import MavlinkConfig
from bridges.mavlink.mission_items import PlanKind
from bridges.mavlink.mission_protocol import Upload
from bridges.mavlink.parameter_errands import ReadParameters, SetParameter
from bridges.mavlink.pilot_report import PilotReport
from bridges.mavlink.placing import team_frame
from bridges.mavlink.visit import Visit
from estimator.arrays import FloatArray

BYTEWISE = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
CEILING = {"ArduPilot": "FENCE_ALT_MAX", "PX4": "GF_MAX_VER_DIST"}  # m above home
RADIUS = {"ArduPilot": "FENCE_RADIUS", "PX4": "GF_MAX_HOR_DIST"}  # m around home
ASKED = {
    "ArduPilot": ("FENCE_ENABLE", "FENCE_TYPE", "FENCE_OPTIONS"),
    "PX4": ("GF_ACTION",),
}
CIRCLE, POLYGONS, UNION = 2, 4, 2  # bits of FENCE_TYPE, and of FENCE_OPTIONS


def put_on_board(visit: Visit, mission_name: str, yes: bool) -> int:
    """Ask, upload, read back, and say what else keeps the fence from being heeded; the exit status.

    Raises:
        MissionError, DataError: if the mission is wrong, or has no such vehicle.
        LinkError: if the vehicle does not take it.
    """
    mission = load(mission_name)
    visit.meet()
    report, _ = visit.listen()
    robot, config = _robot(mission, report.system)
    if report.home is None:
        raise LinkError(f"system {report.system} has no home position yet; wait until it knows where it is")
    if report.armed:
        raise LinkError(f"system {report.system} is armed; its fence is changed on the ground only")
    frame = team_frame(config, _context(mission, robot), report.home)
    fence, ceiling = mission_fence(mission, config, frame)
    above_home = ceiling - float(frame.from_degrees(report.home)[2])
    before = visit.download(PlanKind.FENCE)
    values = _read(visit, report)
    name = CEILING[report.autopilot]
    old = values.get(name)
    print(
        f"the fence of {mission.name} for robot {robot.id}, system {report.system}: {len(fence.items)} items"
    )
    print(f"it replaces {len(before)} items on board")
    if report.body == "copter" and old is not None:
        print(f"{name}: {old:g} becomes {above_home:.1f} m above home")
    for sentence in fence.left_out:
        print(f"left out: {sentence}")
    if not yes:
        if not sys.stdin.isatty():
            raise MissionError("nobody can be asked here; give --yes if it may be replaced")
        if not typer.confirm("Put it on board?", default=False):
            print("nothing was changed", file=sys.stderr)
            return 1
    _upload(visit, report, fence)
    if report.body == "copter" and old is not None:
        _set(visit, report, name, round(above_home, 1))
    home = frame.from_degrees(report.home)
    far = max(float(np.hypot(*(frame.from_degrees((i.x, i.y, 0.0)) - home)[:2])) for i in fence.items)
    for sentence in _unheeded(report, values, fence.inclusions, far):
        print(f"beware: {sentence}")
    print("it is on board, and was read back the same")
    return 0


def mission_fence(mission: Mission, config: MavlinkConfig, frame: TeamFrame) -> tuple[Fence, float]:
    """The fence, and the highest altitude in the team's frame: where the bridge calls it a breach, too.

    That is the mission's geofence as it is written, or without one its area and twice the vehicle's margin.
    """
    plan, area = ground_plan(mission), mission.box()
    room = 2 * config.margin_m
    inside = plan.fences or (box_shape(area.low[:2] - room, area.high[:2] + room),)

    def degrees(points: FloatArray) -> FloatArray:
        return np.array([frame.to_degrees(np.array([x, y, 0.0]))[:2] for x, y in points])

    ceiling = config.bounds[1]
    if plan.altitude is not None:
        ceiling = min(ceiling, plan.altitude[1])
    return fence_items(inside, (*plan.obstacles, *plan.keep_out), degrees), ceiling + config.margin_m


def _robot(mission: Mission, system: int | None) -> tuple[RobotTable, MavlinkConfig]:
    known = []
    for robot in mission.robots:
        if robot.vehicle["kind"] != "mavlink":
            continue
        kind = plugins.load("vehicles", "mavlink")
        body: dict[str, Any] = {key: value for key, value in robot.vehicle.items() if key != "kind"}
        config: MavlinkConfig = convert(body, kind.Config, mission.directory or None)
        if config.system_id == system:
            return robot, config
        known.append(config.system_id)
    names = f"only {', '.join(map(str, known))}" if known else "no vehicle of kind mavlink at all"
    raise MissionError(
        f"{mission.name} has no robot with system_id {system}, {names}; correct one of the two"
    )


def _context(mission: Mission, robot: RobotTable) -> DeviceContext:
    """What says where the team's frame lies; nobody looks at the rest."""
    origin = mission.origin
    place = None if origin is None else (origin.latitude, origin.longitude, origin.altitude)
    return DeviceContext(robot.id, 0, mission.box(), _Nothing(), start_pose(robot), origin=place)


class _Nothing:
    def targets(self, time: float) -> FloatArray:
        """None."""
        return np.zeros((2, 0))


def _read(visit: Visit, report: PilotReport) -> dict[str, float]:
    bytewise = bool((report.capabilities or 0) & BYTEWISE)
    name = report.autopilot
    names = (*ASKED[name], CEILING[name], RADIUS[name])
    errand = ReadParameters(names, report.system or 1, bytewise)
    visit.run(errand, "reading its fence parameters")
    return dict(errand.values)


def _upload(visit: Visit, report: PilotReport, fence: Fence) -> None:
    errand = Upload(fence.items, PlanKind.FENCE, *visit.addresses(report))
    visit.run(errand, "the upload of the fence")
    back = visit.download(PlanKind.FENCE)
    same = len(back) == len(fence.items) and all(
        one.command == two.command and abs(one.x - two.x) < 2e-7 and abs(one.y - two.y) < 2e-7
        for one, two in zip(back, fence.items, strict=True)
    )
    if not same:
        raise LinkError(f"{len(fence.items)} items went up, but {len(back)} others came back; try again")


def _set(visit: Visit, report: PilotReport, name: str, value: float) -> None:
    errand = SetParameter(name, value, report.system or 1)
    visit.run(errand, f"setting {name}")
    if errand.trouble:
        raise LinkError(errand.trouble)


def _unheeded(report: PilotReport, values: dict[str, float], inclusions: int, far: float) -> list[str]:
    """Why the autopilot would not heed the fence as meant; these parameters are its operator's choice."""
    found = []
    name = RADIUS[report.autopilot]
    radius = values.get(name, 0.0)
    circle = report.autopilot == "PX4" or int(values.get("FENCE_TYPE", 0)) & CIRCLE
    if circle and 0 < radius < far:
        found.append(
            f"{name} = {radius:g}: it also stays within this circle, but the fence reaches {far:.0f} m"
        )
    if report.autopilot == "ArduPilot":
        if not values.get("FENCE_ENABLE"):
            found.append("FENCE_ENABLE = 0: it does not heed any fence; set it to 1")
        if not int(values.get("FENCE_TYPE", 0)) & POLYGONS:
            found.append("FENCE_TYPE leaves polygons out; add 4 to it")
        if inclusions > 1 and not int(values.get("FENCE_OPTIONS", 0)) & UNION:
            found.append("FENCE_OPTIONS wants it within all areas at once; add 2 to it")
    elif int(values.get("GF_ACTION", 0)) in (0, 1):
        found.append(
            f"GF_ACTION = {values.get('GF_ACTION', 0):g}: it flies on over the fence; set it to 2 or more"
        )
    return found
