"""What many runs say together: means with 95% intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

MEANS = (
    "targets_found",
    "false_found",
    "time_to_all_found_s",
    "measurements_to_all_found",
    "measurement_sets",
    "rmse_m",
    "gospa",
    "expected_cardinality",
    "min_separation_m",
    "speed_up",
)


def mean_with_interval(values: Sequence[float]) -> dict[str, float | int | None]:
    """Mean, half width of its 95% interval (Student's t; None for a single value), least, most, count."""
    array = np.asarray(values, dtype=np.float64)
    if array.size == 0:
        return {"mean": None, "half_width_95": None, "min": None, "max": None, "n": 0}
    half = None
    if array.size > 1:
        from scipy.stats import t  # noqa: PLC0415  (slow to import, and only needed here)

        half = float(t.ppf(0.975, array.size - 1) * array.std(ddof=1) / np.sqrt(array.size))
    return {
        "mean": float(array.mean()),
        "half_width_95": half,
        "min": float(array.min()),
        "max": float(array.max()),
        "n": int(array.size),
    }


def aggregate(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Of the summaries of many runs. Times and counts to all found are over the runs that found all."""
    result: dict[str, Any] = {
        "runs": len(runs),
        "runs_all_found": sum(bool(run["all_found"]) for run in runs),
    }
    for name in MEANS:
        values = [run[name] for run in runs if run.get(name) is not None]
        result[name] = mean_with_interval(values)
    return result


def means(runs: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> dict[str, Any]:
    """Of each key: the mean over the runs that have it."""
    return {key: mean_with_interval([run[key] for run in runs if run.get(key) is not None]) for key in keys}


def paired(
    runs: Sequence[Mapping[str, Any]], others: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> dict[str, Any]:
    """Of each key: the mean of what a run has more than the other run of its seed, where both have it.

    Raises:
        ValueError: if the runs are not of the same seeds, in the same order.
    """
    if [run["seed"] for run in runs] != [other["seed"] for other in others]:
        raise ValueError("others: expected runs of the same seeds in the same order")
    both = list(zip(runs, others, strict=True))
    return {
        key: mean_with_interval(
            [a[key] - b[key] for a, b in both if a.get(key) is not None and b.get(key) is not None]
        )
        for key in keys
    }
