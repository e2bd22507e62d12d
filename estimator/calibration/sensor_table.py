"""A calibration as the sensor's table of a mission."""

from typing import Any

import numpy as np

from estimator.calibration.result import Calibration

_BEYOND = 0.01  # p_D at the end of the sector: a target a little further than any ever seen is no miracle


def sensor_table(found: Calibration, *, period: float, body_frame: bool) -> dict[str, Any]:
    """The keys of `range_bearing`, `bearing_only` or `range_only`, whichever measures the same, without kind.

    The sector is wide and long enough for all that was measured, clutter too: what lies outside has a clutter
    intensity of 0 and would have to be a target. p_D is the table over the range, tapered beyond the farthest
    target seen. A sector lies about the heading: one that does not is made to reach as far on both sides.
    """
    out: dict[str, Any] = {"period_s": period}
    if "range" in found.sigmas:
        out["range_sigma_m"] = _short(found.sigmas["range"])
    if "bearing" in found.sigmas:
        out["bearing_sigma_deg"] = _short(np.degrees(found.sigmas["bearing"]))
        out["bearing_frame"] = "body" if body_frame else "world"
    out["gain"] = 1.0
    out["clutter"] = _short(found.clutter)
    if found.quantities == ("bearing",):
        peaked = np.isfinite(found.clutter_peak)
        out["beam_separation_deg"] = 0.0  # what beams do to p_D is in the table
        out["clutter_uniform"] = _short(found.clutter_uniform) if peaked else 1.0
        if peaked:
            out["clutter_peak_deg"] = _short(np.degrees(found.clutter_peak))
    reach, off = found.measured
    spread = found.sigmas.get("range", 0.0)
    far = np.nanmax([found.farthest + 3.0 * spread, reach])
    half = np.degrees(np.nanmax([np.abs(found.opening).max(), off]))
    out["field_of_view"] = "sector"
    out["min_range_m"] = float(max(0.0, np.floor(10.0 * (found.nearest - 3.0 * spread)) / 10.0))
    out["range_m"] = float(np.ceil(10.0 * far) / 10.0)
    out["angle_deg"] = float(min(360.0, np.ceil(2.0 * half)))
    known = np.isfinite(found.gains)
    breaks = [round(float(x), 3) for x in found.breaks[known]]
    gains = [round(float(x), 3) for x in found.gains[known]]
    farthest = round(found.farthest, 3)
    if out["range_m"] > max(farthest, breaks[-1]):
        if farthest > breaks[-1]:
            breaks, gains = [*breaks, farthest], [*gains, gains[-1]]
        breaks, gains = [*breaks, out["range_m"]], [*gains, _BEYOND]
    return {**out, "range_breaks_m": breaks, "range_gains": gains}


def _short(value: float) -> float:
    """Four digits: more are never known."""
    return float(f"{value:.4g}")
