"""Whether somebody else flies the vehicle now: an operator by radio or ground station, or the autopilot.

Only the mode says so, and every mode that we have not asked for does.
"""

from bridges.mavlink.autopilot import Autopilot
from bridges.mavlink.dialect import mavlink
from bridges.mavlink.vehicle_state import VehicleReport

UNTIL = "it is left alone until resumed"
LATELY = 5.0  # s in which a failsafe has said its name


def taken_by(phase: str, there: bool, autopilot: Autopilot, report: VehicleReport, now: float) -> str | None:
    """Why it is not ours any more, in a sentence; `there`: the mode that the phase asked for was seen."""
    mode = autopilot.mode(report)
    land, home = autopilot.land_mode, autopilot.return_mode
    if phase in ("climbing", "flying"):
        if not report.armed:
            return f"it was disarmed in mode {mode} while it was ours; {UNTIL}"
        fine = {autopilot.guided}
    elif phase in ("landing", "returning") and report.armed:
        # A return ends with a landing, and a change between the two is ours until it shows.
        fine = ({land} if phase == "landing" else {land, home}) if there else {land, home, autopilot.guided}
    else:
        return None
    return None if mode in fine else who(report, mode, now)


def who(report: VehicleReport, mode: str, now: float) -> str:
    """A failsafe says its name or shows as a critical state; else it was a person."""
    said = [text for text in report.since(now - LATELY) if "failsafe" in text.lower()]
    if said or report.system_status >= mavlink.MAV_STATE_CRITICAL:
        because = f": {'; '.join(dict.fromkeys(said))}" if said else ""
        return f"the autopilot's own failsafe took it to mode {mode}{because}; {UNTIL}"
    return f"somebody took it over: mode {mode}; {UNTIL}"
