"""Determinism: a posterior is what its sets give when they are applied in the order of their capture, once.

However they came: shuffled, doubled, late, over partitions and restarts. The same bits are asked for.
"""

from collections.abc import Sequence

import numpy as np

from agents.fusion.fusion import Fusion, FusionSetup
from agents.fusion.watermark import covers, source
from agents.invariants.connections import Truth
from agents.invariants.history import RunHistory
from agents.invariants.report import Report
from agents.invariants.sets import ECHO, TWICE
from agents.machine import Heard, Publish
from agents.team import Team
from agents.wire.messages import LedgerEntry, MeasurementSetMessage, PosteriorMessage
from agents.wire.topics import SET, SOFT_OBSERVATION

DETERMINISM = "determinism"
_BATCH = 64
_FIELDS = ("means", "covariances", "masses", "radii", "found", "found_times", "found_labels")


def replays(history: RunHistory, truth: Truth, report: Report) -> None:
    """The last posterior of every fusion is that of its ledger, applied again in order."""
    last: dict[str, tuple[float, PosteriorMessage]] = {}
    for at, message in history.by(PosteriorMessage):
        last[message.sender] = (at, message)
    for fusion, (at, posterior) in last.items():
        entries = [e for e in history.ledgers.get(fusion, ()) if _covered(posterior, e)]
        sets = sum(isinstance(entry, MeasurementSetMessage) for entry in entries)
        if not entries or sets < posterior.applied:
            report.counts["posteriors not replayed: their ledger is not at hand"] += 1
            continue
        if posterior.applied < sets:
            report.counts["posteriors not replayed: sets expired"] += 1
            continue
        in_order = sorted(entries, key=_key)
        again = replayed(Team.of(history.mission), history.seed, in_order)
        report.counts["posteriors replayed"] += 1
        shuffled = in_order != entries
        report.counts["posteriors of sets out of order"] += shuffled
        difference = _difference(posterior, again)
        if difference:
            row = TWICE if shuffled else DETERMINISM
            report.violate(row, at, f"the posterior of {fusion} is not that of its ledger: {difference}")
        _echo(fusion, at, posterior, again, report)


def replayed(team: Team, seed: int, entries: Sequence[LedgerEntry]) -> PosteriorMessage:
    """The posterior of entries that come in this order."""
    setup = FusionSetup(team.mission, "fusion", "replay", team.search(), team.sensor_models)
    fusion = Fusion(setup, seed)
    posterior: PosteriorMessage | None = None
    for first in range(0, len(entries), _BATCH):
        batch = entries[first : first + _BATCH]
        heard = [Heard(SET if isinstance(e, MeasurementSetMessage) else SOFT_OBSERVATION, e) for e in batch]
        for action in fusion.step(batch[-1].time, heard):
            if isinstance(action, Publish) and isinstance(action.message, PosteriorMessage):
                posterior = action.message
    assert posterior is not None, "a replay of nothing"
    return posterior


def _difference(one: PosteriorMessage, other: PosteriorMessage) -> str:
    """What differs, in words; "" if every bit is the same."""
    if one.applied != other.applied:
        return f"{one.applied} sets applied, {other.applied} in the replay"
    if one.expected_cardinality != other.expected_cardinality:
        return f"{one.expected_cardinality!r} targets expected, {other.expected_cardinality!r} in the replay"
    for name in _FIELDS:
        if not np.array_equal(getattr(one, name), getattr(other, name)):
            return f"{name} differ"
    return ""


def _echo(fusion: str, at: float, one: PosteriorMessage, other: PosteriorMessage, report: Report) -> None:
    """Nothing but measurements may make a team surer than its measurements make it."""
    more = one.expected_cardinality - other.expected_cardinality
    if more > 1e-9:
        report.violate(ECHO, at, f"{fusion} expects {more:.3g} targets more than its sets give")
    if one.covariances.shape == other.covariances.shape and one.covariances.size:
        smaller = np.trace(other.covariances - one.covariances, axis1=1, axis2=2).max()
        if smaller > 1e-9:
            report.violate(ECHO, at, f"{fusion} is surer of a target than its sets make it")


def _key(entry: LedgerEntry) -> tuple[float, str, str, int]:
    return entry.time, entry.sender, entry.boot, entry.sequence


def _covered(posterior: PosteriorMessage, entry: LedgerEntry) -> bool:
    """A posterior need not tell of boots that ended: all that is known of those is in it."""
    name = source(entry.sender, entry.boot)
    return name not in posterior.watermark or covers(posterior.watermark[name], entry.sequence)
