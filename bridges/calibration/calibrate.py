"""`searchparty calibrate`: a sensor's table from measurements of a known truth."""

# ruff: noqa: PLC0415 - what reads and fits is imported when the command runs, not when it is listed

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from agents.errors import DataError, MissionError, StorageError

if TYPE_CHECKING:
    from agents.mission.mission import Mission
    from estimator.calibration.result import Calibration, Options

CAMERA_PERIOD_S = 0.235  # of the MRCLAM robots, see docs/mrclam.md


def calibrate(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="An MRCLAM directory, or that of a run whose world knows the truth."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the mission here instead of printing it.")
    ] = None,
    mission: Annotated[
        str | None,
        typer.Option(
            metavar="MISSION", help="MRCLAM: put the sensors into this mission of it, not a new one."
        ),
    ] = None,
    robot: Annotated[
        list[str] | None, typer.Option(metavar="ID", help="Only this robot (MRCLAM: its number). Repeatable.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what a program would read.")] = False,
    anonymous: Annotated[
        bool, typer.Option("--anonymous", help="MRCLAM: do not use barcodes to tell who was seen.")
    ] = False,
    breaks: Annotated[
        str,
        typer.Option(metavar="M,M,...", help="Ranges of the table of p_D, m; else eight over those seen."),
    ] = "",
    range_gate: Annotated[float, typer.Option(metavar="M", help="A greater error is no noise.")] = 1.0,
    reach: Annotated[
        float, typer.Option(metavar="M", help="No target further away is seen; else found out.")
    ] = float("inf"),
    bearing_gate: Annotated[float, typer.Option(metavar="DEG", help="A greater error is no noise.")] = 10.0,
) -> None:
    """Estimate sensors' noise, p_D and clutter from a recording with known truth; print a mission with them.

    The mission is one that `searchparty check` accepts, with each estimate's 95% interval in
    comments. Exit status 4 if the recording is missing, malformed or too short.

    \b
    Examples:
      searchparty calibrate MRCLAM_Dataset6 > calibrated.toml
      searchparty calibrate MRCLAM_Dataset6 --mission missions/mrclam.toml --out calibrated.toml
      searchparty calibrate runs/depot-20260101-120000 --json
    """
    import json
    import math

    from agents.swarm.run_directory import finite
    from bridges.calibration.report import comments, facts
    from estimator.calibration.result import Options

    table = _breaks(breaks)
    try:
        options = Options(range_gate, math.radians(bearing_gate), table, reach=reach)
    except ValueError as error:
        raise MissionError(f"--{str(error).replace('_', '-', 1)}") from None
    if list(recording.glob("Robot*_Groundtruth.dat")):
        found, tables, made = _mrclam(recording, robot or [], mission, anonymous, options)
    else:
        if mission is not None or anonymous:
            raise MissionError("--mission and --anonymous are for MRCLAM recordings; a run has its mission")
        found, tables, made = _run(recording, robot or [], options)
    if as_json:
        robots = {name: {**facts(one), "sensor": tables[name]} for name, one in found.items()}
        print(json.dumps(finite({"recording": str(recording), "robots": robots}), indent=2))
    text = "".join(comments(name, one) for name, one in found.items()) + "\n" + made
    if out is not None:
        try:
            out.write_text(text)
        except OSError as error:
            raise StorageError(f"cannot write {out}: {error.strerror}; choose another --out") from None
    elif not as_json:
        print(text, end="")


Result = tuple[dict[str, "Calibration"], dict[str, dict[str, Any]], str]  # by robot, tables by robot, mission


def _breaks(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise MissionError(f"--breaks: found {text!r}, allowed are numbers such as 1,2,4,8") from None


def _calibrated(name: str, recording: Any, options: "Options") -> "Calibration":
    from estimator.calibration.calibrate import calibrate as fit

    try:
        return fit(recording, options)
    except ValueError as error:
        raise DataError(f"robot {name}: {error}") from None


def _run(directory: Path, wanted: list[str], options: "Options") -> Result:
    from bridges.rerun.run_recording import read_run
    from estimator.calibration.sensor_table import sensor_table

    base, recordings = read_run(directory)
    missing = sorted(set(wanted) - set(recordings))
    if missing:
        raise DataError(f"{directory}: no sets of a robot {missing[0]}; there are {', '.join(recordings)}")
    found, tables = {}, {}
    for name in wanted or recordings:
        found[name] = _calibrated(name, recordings[name], options)
        sensor = base.robot(name).sensor
        body = recordings[name].body_frame
        tables[name] = {
            "kind": sensor["kind"],
            **sensor_table(found[name], period=sensor["period_s"], body_frame=body),
        }
    return found, tables, _with_sensors(base, tables)


def _mrclam(
    directory: Path, wanted: list[str], mission: str | None, anonymous: bool, options: "Options"
) -> Result:
    from dataclasses import replace
    from math import degrees

    from agents.mission.mission_file import load
    from bridges.mrclam import calibration as mrclam
    from bridges.mrclam.mission import mission_of
    from estimator.calibration.sensor_table import sensor_table

    try:
        numbers = [int(one) for one in wanted] or mrclam.robots_of(directory)
    except ValueError:
        raise MissionError(f"--robot: found {', '.join(wanted)}, allowed are the robots' numbers") from None
    base = None if mission is None else load(mission)
    recorded = mrclam.read_robots(directory, numbers)
    cameras = mrclam.fit_cameras(directory, recorded, CAMERA_PERIOD_S)
    options = replace(options, bystander_radius=mrclam.BODY_RADIUS_M)
    found, tables = {}, {}
    for one, camera in zip(recorded, cameras, strict=True):
        name = f"r{one.number}"
        sets = mrclam.recording_of(directory, one, camera, CAMERA_PERIOD_S, named=not anonymous)
        found[name] = _calibrated(name, sets, options)
        table = sensor_table(found[name], period=CAMERA_PERIOD_S, body_frame=True)
        table |= {"kind": "mrclam", "robot": one.number}
        table["camera"] = {
            "depth_scale": round(camera.depth_scale, 4),
            "axis_deg": round(degrees(camera.axis), 2),
            "forward_m": round(camera.forward, 4),
            "bearing_deg": round(degrees(camera.bearing[0]), 3),
            "bearing_slope": round(camera.bearing[1], 4),
            "bearing_curve": round(camera.bearing[2], 4),
            "delay_s": round(camera.delay, 4),
        }
        tables[name] = table
    if base is None:
        return found, tables, mission_of(directory, recorded, tables)
    numbered = {table["robot"]: table for table in tables.values()}
    named = {
        robot.id: numbered[robot.sensor["robot"]]
        for robot in base.robots
        if robot.sensor["kind"] == "mrclam" and robot.sensor["robot"] in numbered
    }
    if not named:
        raise MissionError(f"{mission}: none of its robots replays one of these: {', '.join(tables)}")
    return found, tables, _with_sensors(base, named)


def _with_sensors(base: "Mission", tables: dict[str, dict[str, Any]]) -> str:
    """A mission in which the robots named have other sensors, as TOML."""
    import msgspec

    from agents.mission.mission_file import dumps

    robots = [
        msgspec.structs.replace(robot, sensor=tables.get(robot.id, robot.sensor)) for robot in base.robots
    ]
    return dumps(msgspec.structs.replace(base, robots=robots))
