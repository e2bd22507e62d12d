"""What a vehicle is, for people and for programs."""

import math
from collections.abc import Mapping
from typing import Any

from bridges.mavlink.dialect import mavlink
from bridges.mavlink.mission_items import Item
from bridges.mavlink.pilot_report import PilotReport

WARNED = ("ground link", "low battery", "estimator", "fence", "radio control")


def capabilities(bits: int | None) -> list[str]:
    """The names of MAV_PROTOCOL_CAPABILITY bits."""
    return _names("MAV_PROTOCOL_CAPABILITY", "MAV_PROTOCOL_CAPABILITY_", bits)


def estimator(flags: int | None, autopilot: str) -> list[str]:
    """The names of an estimator's flags."""
    if autopilot == "ArduPilot":
        return _names("EKF_STATUS_FLAGS", "EKF_", flags)
    return _names("ESTIMATOR_STATUS_FLAGS", "ESTIMATOR_", flags)


def fix(number: int | None) -> str:
    """A GPS fix in words."""
    entry = mavlink.enums["GPS_FIX_TYPE"].get(number)
    return "unknown" if entry is None else entry.name.removeprefix("GPS_FIX_TYPE_").lower().replace("_", " ")


def info(report: PilotReport, url: str, rates: Mapping[str, float]) -> dict[str, Any]:
    """All that `--info` tells, ready for JSON."""
    counts = dict(report.counters or {})
    return {
        "url": url,
        "system_id": report.system,
        "component_id": 1,
        "type": report.body,
        "autopilot": report.autopilot,
        "version": report.version,
        "mode": report.mode,
        "armed": report.armed,
        "in_air": report.in_air,
        "position_ned_m": None if report.position is None else [round(float(x), 3) for x in report.position],
        "velocity_ned_m_s": None
        if report.velocity is None
        else [round(float(x), 3) for x in report.velocity],
        "attitude_deg": None
        if report.attitude is None
        else [round(math.degrees(x), 2) for x in report.attitude],
        "place": report.where,
        "home": report.home,
        "origin": report.origin,
        "battery": report.battery,
        "voltage": report.voltage,
        "gps_fix": fix(report.gps_fix),
        "satellites": report.satellites,
        "estimator": estimator(report.estimator_flags, report.autopilot),
        "link_quality": round(report.link_quality, 4),
        "round_trip_s": report.round_trip,
        "clock_offset_s": report.clock_offset,
        "radio": report.radio,
        "capabilities": capabilities(report.capabilities),
        "modes": list(report.modes),
        "rates_hz": {name: round(rate, 2) for name, rate in rates.items()},
        "failsafes": [
            {"cause": one.cause, "action": one.action, "words": one.words, "after_s": one.after}
            for one in report.failsafes
        ],
        "not_ready": list(report.reasons),
        "counters": {name: counts[name] for name in sorted(counts) if counts[name]},
    }


def info_lines(found: Mapping[str, Any]) -> list[tuple[str, str]]:
    """`info` as rows of a table."""
    air = "flying" if found["in_air"] else "on the ground"
    quality = f"{found['link_quality']:.1%} of its messages arrive"
    if found["round_trip_s"] is not None:
        quality += f", round trip {found['round_trip_s'] * 1e3:.1f} ms"
    power = "unknown" if found["battery"] is None else f"{found['battery']:.0%}"
    if found["voltage"] is not None:
        power += f", {found['voltage']:.1f} V"
    rows = [
        (
            "vehicle",
            f"{found['type']} with {found['autopilot']} {found['version']}, system {found['system_id']}",
        ),
        ("state", f"{found['mode']}, {'ARMED' if found['armed'] else 'disarmed'}, {air}"),
        ("place", _place(found["place"])),
        ("home", _place(found["home"])),
        ("origin", _place(found["origin"])),
        ("battery", power),
        ("GPS", f"{found['gps_fix']}, {found['satellites']} satellites"),
        ("estimator", ", ".join(found["estimator"]) or "it has not said"),
        ("link", quality),
        ("can", ", ".join(found["capabilities"]) or "it has not said"),
        ("modes", ", ".join(found["modes"])),
        ("telemetry", ", ".join(f"{name} {rate:.1f} Hz" for name, rate in found["rates_hz"].items())),
    ]
    rows += [(f"on {one['cause']}", one["words"]) for one in found["failsafes"]]
    rows += [("not ready", reason) for reason in found["not_ready"]] or [
        ("ready", "nothing stops it from arming")
    ]
    return rows


def warnings(report: PilotReport) -> list[str]:
    """What does not stop it from flying, but should be known before."""
    found = [
        f"{one.cause}: {one.words}"
        for one in report.failsafes
        if one.action == "none" and one.cause in WARNED
    ]
    broken = dict(report.counters or {}).get("not_a_number", 0)
    if broken:
        found.append(f"{broken} of its messages held numbers that are none (NaN) and were not believed")
    if report.link_quality < 0.95:
        found.append(f"only {report.link_quality:.0%} of its messages arrive")
    return found


def plan_lines(items: list[Item]) -> list[str]:
    """A plan on board, a line for each item."""
    return [f"{number:3d}  {item.words}" for number, item in enumerate(items, 1)]


def plan_json(items: list[Item]) -> list[dict[str, Any]]:
    """The same for programs; numbers that are none are null."""
    return [
        {
            "command": item.command,
            "frame": item.frame,
            "latitude": round(item.x, 7),
            "longitude": round(item.y, 7),
            "height_m": item.z,
            "params": [None if math.isnan(value) else value for value in item.params],
            "words": item.words,
        }
        for item in items
    ]


def _place(place: tuple[float, float, float] | None) -> str:
    if place is None:
        return "it has not said"
    return f"{place[0]:.7f}, {place[1]:.7f}, {place[2]:.1f} m above sea level"


def _names(enum: str, prefix: str, bits: int | None) -> list[str]:
    return [
        entry.name.removeprefix(prefix).lower().replace("_", " ")
        for bit, entry in sorted(mavlink.enums[enum].items())
        if bits is not None and bit & (bit - 1) == 0 and bits & bit and "RESERVED" not in entry.name
    ]
