"""A vehicle in one line, for `searchparty status` and the terminal."""

from bridges.mavlink.pilot_report import PilotReport

FIX = {0: "no GPS", 1: "no fix", 2: "2D fix", 3: "3D fix", 4: "DGPS", 5: "RTK float", 6: "RTK"}
ABSOLUTE, CONSTANT = 16, 128  # bits of the estimator's flags


def summary(report: PilotReport) -> str:
    """At most 200 characters."""
    if not report.autopilot:
        return (report.trouble or report.phase)[:200]
    flags = report.estimator_flags
    blind = CONSTANT if report.autopilot == "ArduPilot" else 0  # a PX4 sets it whenever it stands still
    good = flags is not None and flags & ABSOLUTE and not flags & blind
    parts = [report.mode, "in air" if report.in_air else "armed" if report.armed else "disarmed"]
    if report.battery is not None:
        parts.append(f"battery {report.battery:.0%}")
    if report.gps_fix is not None:
        parts.append(FIX.get(report.gps_fix, f"fix {report.gps_fix}"))
    parts.append("EKF good" if good else "EKF unknown" if flags is None else "EKF bad")
    parts.append(f"link {report.link_quality:.0%}")
    if not report.ours:
        parts.append(report.phase)
    who = " ".join(filter(None, (report.autopilot, report.version, report.body)))
    parts[-1] += f" ({who})"
    return (", ".join(parts) + (f": {report.trouble}" if report.trouble else ""))[:200]
