"""A calibration in words: lines for people, keys for programs."""

import math
from typing import Any

import numpy as np

from estimator.calibration.result import Calibration

Row = tuple[str, float, tuple[float, float], str]  # name, value, its 95% interval, unit


def rows(found: Calibration) -> list[Row]:
    """Every estimate with its interval, angles in degrees."""
    degree = 180.0 / np.pi
    out: list[Row] = []
    for name, key, values in (("sigma", "sigmas", found.sigmas), ("bias", "biases", found.biases)):
        for i, quantity in enumerate(found.quantities):
            scale, unit = (1.0, "m") if quantity == "range" else (degree, "deg")
            low, high = found.intervals[key][i]
            out.append((f"{quantity}_{name}", values[quantity] * scale, (low * scale, high * scale), unit))
    out.append(("outliers", found.outliers, found.intervals["outliers"][0], "share of sightings"))
    for name, value, (low, high) in zip(
        ("opening_from", "opening_to"), found.opening, found.intervals["opening"], strict=True
    ):
        out.append((name, value * degree, (low * degree, high * degree), "deg off the heading"))
    for at, gain, span in zip(found.breaks, found.gains, found.intervals["gains"], strict=True):
        out.append((f"p_D at {at:.2f} m", float(gain), span, ""))
    for at, gain, span in zip(
        found.sectors, found.sector_gains, found.intervals["sector_gains"], strict=True
    ):
        out.append((f"p_D at {at * degree:.0f} deg", float(gain), span, "of the table's"))
    out.append(("clutter", found.clutter, found.intervals["clutter"][0], "per set"))
    if np.isfinite(found.clutter_peak):
        low, high = found.intervals["clutter_peak"][0]
        out.append(("clutter_uniform", found.clutter_uniform, found.intervals["clutter_uniform"][0], "share"))
        out.append(("clutter_peak", found.clutter_peak * degree, (low * degree, high * degree), "deg wide"))
    return out


def facts(found: Calibration) -> dict[str, Any]:
    """What `--json` prints of one sensor."""
    return {
        "sets": found.sets,
        "sightings": found.sightings,
        "trials": found.trials,
        "nearest_m": found.nearest,
        "farthest_m": found.farthest,
        "estimates": [
            {"name": name, "value": _finite(value), "low": _finite(low), "high": _finite(high), "unit": unit}
            for name, value, (low, high), unit in rows(found)
        ],
        "clutter_peaks": [
            {
                "centre_deg": math.degrees(peak.centre),
                "width_deg": math.degrees(peak.width),
                "share": peak.share,
            }
            for peak in found.peaks
        ],
    }


def comments(robot: str, found: Calibration) -> str:
    """Lines of TOML comment that give each estimate with its 95% interval."""
    head = f"{robot}: {found.sightings} sightings in {found.sets} sets, {found.trials} times in view"
    lines = [head + f", {found.nearest:.2f} to {found.farthest:.2f} m away"]
    lines += [
        f"  {name} = {_short(value)} ({_short(low)} to {_short(high)}){' ' + unit if unit else ''}"
        for name, value, (low, high), unit in rows(found)
    ]
    for peak in found.peaks:
        centre, width = math.degrees(peak.centre), math.degrees(peak.width)
        lines.append(
            f"  clutter crowds within {width:.0f} deg around {centre:.0f} deg: {peak.share:.0%} of it"
        )
    return "".join(f"# {line}\n" for line in lines)


def _short(value: float) -> str:
    return "0" if abs(value) < 1e-6 else f"{value:.4g}"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
