"""`searchparty simulate --compare`: the same mission and seeds with several planners, seed by seed.

Every planner gets the same targets, robots, sensors and filter, so the difference of two planners is taken on
each seed and averaged: what a map makes easy or hard for both cancels. Where a planner that decides each
robot for itself stands beside the one that decides all in a centre, the difference is what decentralisation
costs.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
from rich.table import Table

from agents import plugins
from agents.errors import MissionError
from agents.mission.mission import Mission
from agents.team import Team
from sim.simulate.statistics import paired

Summary = dict[str, Any]
JOINT = "_joint"  # what the kind of a planner in a centre is called beside that of its sibling

# Key of a summary, label, unit: what planners are compared by. Less is better, but of the first.
ROWS = (
    ("targets_found", "targets found", ""),
    ("false_found", "false targets", ""),
    ("time_to_all_found_s", "time to all found", "s"),
    ("measurements_to_all_found", "measurement sets to all found", ""),
    ("distance_m", "distance of all robots", "m"),
    ("rmse_m", "RMSE of found targets", "m"),
    ("gospa", "GOSPA", "m"),
    ("min_separation_m", "least separation", "m"),
    ("plan_ms_p50", "a plan takes, median", "ms"),
)
COSTS = ("time_to_all_found_s", "measurements_to_all_found", "distance_m", "targets_found", "gospa")


def with_planner(mission: Mission, kind: str) -> Mission:
    """The mission with another planner; keys of its own that this planner knows are kept.

    Raises:
        MissionError: if there is no such planner, or it cannot be made for this mission.
    """
    if kind == mission.planner["kind"]:
        return mission
    known = set(plugins.load("planners", kind).Config.__struct_fields__)
    kept = {key: value for key, value in mission.planner.items() if key in known}
    return msgspec.structs.replace(mission, planner={"kind": kind, **kept})


def variants(mission: Mission, names: str) -> dict[str, Mission]:
    """The mission with its own planner first, then with each of the planners named, by kind.

    Raises:
        MissionError: if none is named, or one cannot be used; before anything is run.
    """
    kinds = [name.strip() for name in names.split(",") if name.strip()]
    own = mission.planner["kind"]
    others = [kind for kind in dict.fromkeys(kinds) if kind != own]
    if not others:
        raise MissionError(
            f"--compare: found {names!r}, needed are planners other than the mission's own {own!r}, such as "
            f"{', '.join(kind for kind in plugins.kinds('planners') if kind != own)}"
        )
    made = {kind: with_planner(mission, kind) for kind in (own, *others)}
    for kind in others:
        try:
            Team.of(made[kind])
        except MissionError as error:
            raise MissionError(f"--compare {kind}: {error}") from error
    return made


def flat(runs: Sequence[Mapping[str, Any]]) -> list[Summary]:
    """Summaries with the numbers of ROWS that are deeper inside."""
    return [
        {
            **run,
            "distance_m": sum(run["distance_travelled_m"].values()),
            "plan_ms_p50": run["plan_ms"]["p50"],
        }
        for run in runs
    ]


def differences(runs: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Of every planner but the first: what it has more than the first on the same seed, by key of ROWS."""
    base, *others = runs
    keys = [key for key, _, _ in ROWS]
    return {kind: paired(flat(runs[kind]), flat(runs[base]), keys) for kind in others}


def decentralisation(runs: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """What planning each for itself costs: by kind, what it has more than its sibling in a centre."""
    return {
        kind: paired(flat(runs[kind]), flat(runs[kind + JOINT]), COSTS)
        for kind in runs
        if kind + JOINT in runs
    }


def table(name: str, runs: Mapping[str, Sequence[Mapping[str, Any]]], means: Mapping[str, Any]) -> Table:
    """Means (`statistics.means` by kind) and differences from the first planner, a row for each planner."""
    base, *others = runs
    gaps = differences(runs)
    seeds = len(runs[base])
    shown = Table(
        title=f"{name}: {len(runs)} planners, the same {seeds} seeds",
        caption="mean ± half its 95% interval; * the interval of the difference leaves out 0",
    )
    shown.add_column("")
    shown.add_column("planner")
    shown.add_column("mean", justify="right")
    shown.add_column(f"less that of {base}", justify="right")
    for kind, some in runs.items():
        found = sum(bool(run["all_found"]) for run in some)
        shown.add_row("all found" if kind == base else "", kind, f"{found} of {len(some)} runs", "")
    shown.add_section()
    for key, label, unit in ROWS:
        if all(means[kind][key]["mean"] is None for kind in runs):
            continue
        title = f"{label} ({unit})" if unit else label
        shown.add_row(title, base, _cell(means[base][key], seeds), "")
        for kind in others:
            gap = gaps[kind][key]
            mark = " *" if _sure(gap) else "  "
            shown.add_row("", kind, _cell(means[kind][key], seeds), _cell(gap, seeds, "+") + mark)
        shown.add_section()
    return shown


def sentences(runs: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[str]:
    """What decentralisation costs, in words; nothing where no planner stands beside its joint sibling."""
    told = []
    labels = {key: (label, unit) for key, label, unit in ROWS}
    for kind, costs in decentralisation(runs).items():
        told.append(f"What decentralisation costs ({kind} less {kind + JOINT}, same seeds):")
        for key in COSTS:
            value, (label, unit) = costs[key], labels[key]
            if value["mean"] is None:
                continue
            words = "" if _sure(value) else "; no difference is shown"
            told.append(f"  {label}: {_cell(value, len(runs[kind]), '+')}{' ' + unit if unit else ''}{words}")
        found = [sum(bool(run["all_found"]) for run in runs[name]) for name in (kind, kind + JOINT)]
        told.append(f"  all found in {found[0]} runs, against {found[1]} of {len(runs[kind])}")
    return told


def _sure(value: Mapping[str, Any]) -> bool:
    """Whether the interval of a difference leaves out 0."""
    half = value["half_width_95"]
    return half is not None and abs(value["mean"]) > half


def _cell(value: Mapping[str, Any], seeds: int, sign: str = "") -> str:
    """A mean with its interval; of how many seeds, if not of all."""
    if value["mean"] is None:
        return "-"
    half = value["half_width_95"]
    text = f"{value['mean']:{sign}.2f}" + ("" if half is None else f" ± {half:.2f}")
    return text if value["n"] == seeds else f"{text} (of {value['n']})"
