"""Bounded staleness: nobody decides by what is too old, and everybody goes on without it."""

from collections import defaultdict

from agents.invariants.connections import Truth, overlap
from agents.invariants.history import RunHistory
from agents.invariants.report import Report
from agents.invariants.sets import taken
from agents.wire.messages import MeasurementSetMessage, PoseMessage
from agents.wire.topics import TOPICS

STALE = "bounded staleness"
SLACK_S = 0.05  # of a control loop in virtual time
BUSY_S = 5.0  # of one among processes that share cores with who knows what
ANSWERED_S = 2.0  # of hearing a fusion, until a robot knows how far its clock is off
OBSERVER = "observer"  # who writes the history of real processes: what it cannot hear it cannot miss


def bounded_staleness(history: RunHistory, truth: Truth, report: Report) -> None:
    """No input beyond its topic's limit is used, and its fallback runs: robots go on, whatever is silent."""
    for used in history.used:
        limit = TOPICS[used.topic].stale_after_s
        report.counts["inputs used"] += 1
        if limit and used.age > limit + SLACK_S:
            report.violate(
                STALE,
                used.at,
                f"{used.who} decided by a {used.topic} of {used.sender} that was {used.age:.1f} s old",
            )
    _goes_on(history, truth, report)
    _clocks(history, truth, report)


def _goes_on(history: RunHistory, truth: Truth, report: Report) -> None:
    """Every robot that can look says where it is and measures at its rates, come what may."""
    mission = history.mission
    slack = SLACK_S if history.driver == "virtual" else BUSY_S
    pose_s = mission.settings.pose_period_s
    periods = {robot.id: float(robot.sensor.get("period_s", 0.0)) for robot in mission.robots}
    poses: dict[tuple[str, str], list[float]] = defaultdict(list)
    sets: dict[tuple[str, str], dict[int, float]] = defaultdict(dict)
    for said in history.said:
        message = said.message
        if isinstance(message, PoseMessage):
            poses[message.sender, message.boot].append(said.at)
        elif isinstance(message, MeasurementSetMessage):
            sets[message.sender, message.boot].setdefault(message.sequence, said.at)
    for life in truth.of("robot"):
        source = (life.who, life.boot)
        rates = [("pose", pose_s, poses[source])]
        if periods.get(life.who) and not mission.trigger.enabled:
            rates.append(("set", periods[life.who], sorted(sets[source].values())))
        for topic, period, times in rates:
            report.counts[f"{topic} intervals"] += len(times)
            own = [at for at in times if at <= life.end]  # a later boot may offer what this one left
            for before, after in zip(own, [*own[1:], life.end], strict=False):
                gap = after - before
                away = truth.stopped(life.who) + truth.cut(life.who, OBSERVER)
                if gap <= 1.5 * period + slack or overlap((before, after), away):
                    continue
                report.most(f"{topic}_gap_s", gap)
                report.violate(STALE, after, f"{life.who} said no {topic} for {gap:.2f} s")


def _clocks(history: RunHistory, truth: Truth, report: Report) -> None:
    """Capture times are team time, whatever a robot's own clock shows: within what messages take."""
    if history.driver != "virtual":  # among real processes nobody knows the true time
        return
    late = max((fact.value for fact in history.facts if fact.what == "delay"), default=0.0)
    limit, fusions = SLACK_S + late, truth.of("fusion")
    for (sender, boot, _), (at, entry) in taken(history).items():
        life = truth.life(sender, boot)
        if life is None or life.role != "robot" or at > life.end:  # a later boot says what this one left
            continue
        met = [span for fusion in fusions for span in truth.together(life, fusion)]
        if not any(min(high, at) - low > ANSWERED_S + 2.0 * late for low, high in met):
            report.counts["sets of robots that nobody told the time"] += 1
            continue
        off = abs(entry.time - at)
        report.most("capture_time_error_s", off)
        if off > limit:
            report.violate(STALE, at, f"{sender} says {entry.time:.2f} s of what it took at {at:.2f} s")
