"""Conflict-free tasks: one owner each among robots that hear each other, and none that waits for the dead."""

from collections import defaultdict

from agents.invariants.connections import Interval, Life, Truth, without
from agents.invariants.history import RunHistory
from agents.invariants.report import Report
from agents.mission.mission import Mission
from agents.wire.messages import BidMessage

TASKS = "conflict-free tasks"

ROUNDS_S = 4.0  # in which CBBA comes to an agreement among robots that hear each other
BEYOND_LIVELINESS_S = 2.0  # from the end of liveliness to a new owner

_Claims = dict[str, list[Interval]]  # task -> when a boot said that it is its own


def agreement_limit_s(mission: Mission) -> float:
    """How long two robots that hear each other may both believe that a task is theirs."""
    return mission.link.lease_s + ROUNDS_S


def conflict_free_tasks(history: RunHistory, truth: Truth, report: Report) -> None:
    """No task has two owners for long among robots that hear each other, and none stays a dead robot's."""
    claims, beliefs = _words(history, truth)
    if not claims:
        return
    limit = agreement_limit_s(history.mission)
    lives = [life for life in truth.of("robot") if (life.who, life.boot) in claims]
    for i, one in enumerate(lives):
        for other in lives[i + 1 :]:
            if one.who != other.who:
                _double(one, other, claims, truth, limit, report)
    late = history.mission.link.lease_s + BEYOND_LIVELINESS_S + ROUNDS_S
    for life in truth.of("robot"):
        if life.end < truth.end:
            _orphans(life, lives, beliefs, truth, late, report)


def _words(
    history: RunHistory, truth: Truth
) -> tuple[dict[tuple[str, str], _Claims], dict[tuple[str, str], list[tuple[float, BidMessage]]]]:
    """What each boot claimed when, and all that it said."""
    claims: dict[tuple[str, str], _Claims] = {}
    beliefs: dict[tuple[str, str], list[tuple[float, BidMessage]]] = defaultdict(list)
    open_since: dict[tuple[str, str], dict[str, float]] = defaultdict(dict)
    for at, message in history.by(BidMessage):
        who = (message.sender, message.boot)
        mine = {slot for slot, agent in message.winning_agents.items() if agent == message.sender}
        known = claims.setdefault(who, defaultdict(list))
        beliefs[who].append((at, message))
        for task in [task for task in open_since[who] if task not in mine]:
            known[task].append((open_since[who].pop(task), at))
        for task in mine:
            open_since[who].setdefault(task, at)
    for who, still in open_since.items():
        life = truth.life(*who)
        for task, begin in still.items():
            claims[who][task].append((begin, truth.end if life is None else life.end))
    return claims, beliefs


def _double(
    one: Life,
    other: Life,
    claims: dict[tuple[str, str], _Claims],
    truth: Truth,
    limit: float,
    report: Report,
) -> None:
    mine, theirs = claims[one.who, one.boot], claims[other.who, other.boot]
    spans = truth.together(one, other)
    for task in mine.keys() & theirs.keys():
        for a in mine[task]:
            for b in theirs[task]:
                both = (max(a[0], b[0]), min(a[1], b[1]))
                for span in spans:
                    begin, end = max(both[0], span[0]), min(both[1], span[1])
                    if end <= begin:
                        continue
                    report.counts["tasks with two owners for a while"] += 1
                    report.most("double_ownership_s", end - begin)
                    if end - begin > limit:
                        report.violate(
                            TASKS,
                            end,
                            f"{one.who} and {other.who} both had {task} for {end - begin:.1f} s",
                        )


def _orphans(
    dead: Life,
    lives: list[Life],
    beliefs: dict[tuple[str, str], list[tuple[float, BidMessage]]],
    truth: Truth,
    late: float,
    report: Report,
) -> None:
    """Who heard the dead robot must not wait for it any more."""
    returned = min(
        (l.begin for l in truth.of("robot") if l.who == dead.who and l.begin >= dead.end), default=1e9
    )
    for life in lives:
        if life.who == dead.who or not life.begin <= dead.end < life.end:
            continue
        alone = without((dead.end, min(life.end, returned, truth.end)), truth.stopped(life.who))
        if not alone or alone[0][0] > dead.end:
            continue
        for at, message in beliefs[life.who, life.boot]:
            if not dead.end + late < at < alone[0][1]:
                continue
            report.counts["words after a death"] += 1
            waits = [slot for slot, agent in message.winning_agents.items() if agent == dead.who]
            if waits:
                report.violate(
                    TASKS, at, f"{life.who} leaves {waits[0]} to {dead.who}, dead for {at - dead.end:.1f} s"
                )
                break
