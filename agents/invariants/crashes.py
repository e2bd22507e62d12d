"""Crash safety and determinism: new boots, no number used again, and nothing that was promised forgotten."""

from collections import defaultdict

from agents.fusion.watermark import counted
from agents.invariants.connections import Truth
from agents.invariants.history import RunHistory
from agents.invariants.report import Report
from agents.invariants.sets import acknowledged
from agents.wire import codec
from agents.wire.messages import LedgerEntry, PosteriorMessage

SAFETY = "crash safety"


def crash_safety(history: RunHistory, truth: Truth, report: Report) -> None:
    """After a kill and a start: a new boot id, no id used again, all that was acknowledged still there."""
    _boots(truth, report)
    _numbers(history, truth, report)
    _promises(history, truth, report)


def _boots(truth: Truth, report: Report) -> None:
    seen: dict[tuple[str, str], float] = {}
    for life in truth.lives:
        report.counts["starts of processes"] += 1
        if (life.who, life.boot) in seen:
            report.violate(SAFETY, life.begin, f"{life.who} started again as boot {life.boot}")
        seen[life.who, life.boot] = life.begin


def _numbers(history: RunHistory, truth: Truth, report: Report) -> None:
    """A number stands for one message; only entries for a ledger are said again, and then unchanged."""
    entries: dict[tuple[str, str, str, int], bytes] = {}
    newest: dict[tuple[str, str, str], int] = {}
    for said in history.said:
        message = said.message
        stream = (said.topic, message.sender, message.boot)
        if isinstance(message, LedgerEntry):
            payload = codec.encode(message)
            if entries.setdefault((*stream, message.sequence), payload) != payload:
                report.violate(
                    SAFETY, said.at, f"{message.sender} used {said.topic} {message.sequence} for two messages"
                )
            continue
        if message.sequence <= newest.get(stream, -1):
            report.violate(SAFETY, said.at, f"{message.sender} used {said.topic} {message.sequence} again")
        newest[stream] = max(message.sequence, newest.get(stream, -1))


def _promises(history: RunHistory, truth: Truth, report: Report) -> None:
    """What a watermark told is in the ledger at the end, and no later posterior holds less."""
    for fusion, known in acknowledged(history).items():
        if fusion not in history.ledgers:
            continue
        kept = {(e.sender, e.boot, e.sequence) for e in history.ledgers[fusion]}
        for identity, at in known.items():
            if identity not in kept:
                name = "/".join(map(str, identity))
                report.violate(SAFETY, at, f"{fusion} acknowledged {name}, and its ledger does not hold it")
    most: dict[tuple[str, str], int] = defaultdict(int)
    for at, message in history.by(PosteriorMessage):
        for source, mark in message.watermark.items():
            told = counted(mark)
            if told < most[message.sender, source]:
                report.violate(SAFETY, at, f"{message.sender} forgot of {source}: {told} entries are left")
            most[message.sender, source] = max(most[message.sender, source], told)
