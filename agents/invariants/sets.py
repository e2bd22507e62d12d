"""No set lost, none twice, no echo: what became of every measurement set and soft observation."""

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np

from agents.fusion.watermark import covered
from agents.invariants.connections import Interval, Life, Truth
from agents.invariants.history import RunHistory
from agents.invariants.report import Report
from agents.mission.mission import Mission
from agents.robot.unacknowledged import LONGEST
from agents.wire.messages import (
    BeliefMessage,
    EstimateMessage,
    LedgerEntry,
    MeasurementSetMessage,
    PosteriorMessage,
)

LOST = "no set lost"
TWICE = "none twice"
ECHO = "no echo"

MEET_S = 1.2  # until the two ends of a link have met again after a cut
SPARE_S = 2.0  # for messages underway, and processes that are busy

Identity = tuple[str, str, int]  # sender, boot, sequence


def recovery_limit_s(mission: Mission, late_s: float = 0.0) -> float:
    """T of "no set lost": a set is offered again after LONGEST times `reoffer_after_s` at the latest."""
    again = LONGEST * mission.settings.reoffer_after_s
    return mission.link.lease_s + MEET_S + again + SPARE_S + late_s


def acknowledged(history: RunHistory) -> dict[str, dict[Identity, float]]:
    """By fusion, when a posterior of it first covered each entry."""
    first: dict[str, dict[Identity, float]] = defaultdict(dict)
    reached: dict[tuple[str, str], int] = {}
    for at, message in history.by(PosteriorMessage):
        known = first[message.sender]
        for source, mark in message.watermark.items():
            sender, _, boot = source.partition("/")
            for low, high in covered(mark):
                stream = (message.sender, source)
                begin = max(low, reached.get(stream, -1) + 1) if low == 0 else low
                for number in range(begin, high + 1):
                    known.setdefault((sender, boot, number), at)
                if low == 0:
                    reached[stream] = max(high, reached.get(stream, -1))
    return first


def taken(history: RunHistory) -> dict[Identity, tuple[float, LedgerEntry]]:
    """Every entry as it was first said, and when."""
    first: dict[Identity, tuple[float, LedgerEntry]] = {}
    for said in history.said:
        entry = said.message
        if isinstance(entry, LedgerEntry):
            first.setdefault((entry.sender, entry.boot, entry.sequence), (said.at, entry))
    return first


def no_set_lost(history: RunHistory, truth: Truth, report: Report) -> None:
    """Every set of a connected robot is in every connected fusion in time; the rest are counted by reason."""
    first = acknowledged(history)
    late = max((fact.value for fact in history.facts if fact.what == "delay"), default=0.0)
    limit = recovery_limit_s(history.mission, late)
    fusions, takers = _by_name(truth.of("fusion")), _by_name(truth.lives)
    refused = {fact.who for fact in history.facts if fact.what == "clock" and fact.value}
    spans: dict[tuple[str, str], list[Interval]] = {}
    for identity, (at, _) in taken(history).items():
        boots = takers.get(identity[0])
        if boots is None:
            report.counts["sets of unknown senders"] += 1
            continue
        for fusion, lives in fusions.items():
            key = (identity[0], fusion)
            if key not in spans:  # a boot offers what those before it left
                spans[key] = sorted(
                    s for life in boots for other in lives for s in truth.together(life, other)
                )
            arrived = first[fusion].get(identity)
            due = _due(at, spans[key], limit)
            if arrived is not None:
                report.counts["sets in time"] += 1
                report.most("set_to_fusion_s", arrived - at)
                if due is not None and arrived > due:
                    wait = arrived - (due - limit)
                    report.violate(
                        LOST, arrived, f"{_name(identity)} came to {fusion} {wait:.1f} s after it could"
                    )
            elif due is None or due > truth.end:
                reason = _reason(boots, lives, spans[key], truth)
                report.counts[f"sets not applied: {reason}"] += 1
            elif identity[0] in refused:
                report.counts["sets not applied: clock refused"] += 1
            else:
                report.violate(LOST, due, f"{_name(identity)} of {at:.1f} s is not in {fusion}")


def _by_name(lives: Sequence[Life]) -> dict[str, list[Life]]:
    found: dict[str, list[Life]] = defaultdict(list)
    for life in lives:
        found[life.who].append(life)
    return found


def _due(at: float, spans: list[Interval], limit: float) -> float | None:
    """By when a set must have come: once the two were together for so long."""
    for begin, end in spans:
        if end - max(begin, at) >= limit:
            return max(begin, at) + limit
    return None


def _reason(boots: list[Life], lives: list[Life], spans: list[Interval], truth: Truth) -> str:
    if boots[-1].end < truth.end:
        return "its robot died and did not come back"
    if lives[-1].end < truth.end:
        return "the fusion is dead"
    if spans and spans[-1][1] >= truth.end:
        return "the run ended before"
    return "its robot was cut off to the end"


def none_twice(history: RunHistory, truth: Truth, report: Report) -> None:
    """Nothing is in a ledger twice, and no posterior or belief holds more sets than were ever taken."""
    for fusion, entries in history.ledgers.items():
        counts = Counter((entry.sender, entry.boot, entry.sequence) for entry in entries)
        report.counts["ledger entries"] += len(entries)
        for identity, count in counts.items():
            if count > 1:
                report.violate(TWICE, truth.end, f"{_name(identity)} is {count} times in {fusion}'s ledger")
    times = sorted(at for at, entry in taken(history).values() if isinstance(entry, MeasurementSetMessage))
    for at, message in history.by(EstimateMessage):  # of fusions, and of robots that hear none
        there_are = bisect_right(times, at)
        report.counts["beliefs of robots"] += isinstance(message, BeliefMessage)
        if times and message.applied > there_are:
            report.violate(
                TWICE, at, f"{message.sender} has applied {message.applied} sets, of {there_are} in all"
            )


def no_echo(history: RunHistory, truth: Truth, report: Report) -> None:
    """Every entry of a ledger is what its sender said under that number, and nobody said the same before."""
    first = taken(history)
    for fusion, entries in history.ledgers.items():
        contents: dict[tuple[float, bytes, bytes], Identity] = {}
        for entry in entries:
            identity = (entry.sender, entry.boot, entry.sequence)
            original = first.get(identity)
            if original is not None and not _same(original[1], entry):
                report.violate(ECHO, truth.end, f"{fusion} holds another {_name(identity)} than was said")
            if isinstance(entry, MeasurementSetMessage) and entry.measurements.size:
                content = (entry.time, entry.pose.tobytes(), entry.measurements.tobytes())
                before = contents.setdefault(content, identity)
                if before != identity:
                    report.violate(
                        ECHO, truth.end, f"{_name(identity)} in {fusion} is {_name(before)} said again"
                    )


def _same(one: LedgerEntry, other: LedgerEntry) -> bool:
    if type(one) is not type(other) or one.time != other.time:
        return False
    names = ("pose", "measurements") if isinstance(one, MeasurementSetMessage) else ("points",)
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def _name(identity: Identity) -> str:
    return f"set {identity[0]}/{identity[1]}/{identity[2]}"
