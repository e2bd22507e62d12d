"""How one process hears the others: per topic and peer whether it is alive, at its rate, and valid.

Rates are read off the sequence numbers that senders give, so that what a queue replaced by something newer
counts as said. What is usual per topic stands in the topic table; a mission's own periods go before it.
"""

import math
from collections import deque
from collections.abc import Container, Mapping
from dataclasses import dataclass, field

from agents.mission.mission import Mission
from agents.wire.messages import Message
from agents.wire.roles import ROLES
from agents.wire.topics import TOPICS

WINDOW_S = 5.0  # wall time over which a rate is taken
ENOUGH = 0.7  # share of the usual rate that will do
MISSED = 3.0  # periods without a message after which the rate is not right
LEAST_S = 2.5  # and never before this: processes that share a machine are late at times

# Those that come by a clock; others come when there is something to say.
PERIODIC = ("pose", "set", "posterior", "picture", "start", "health")
PROMPT = ("pose", "set", "start")  # sent at their time; a posterior's is that of the newest set in it


@dataclass(frozen=True, slots=True)
class Stream:
    """What one peer says on one topic, as it arrives here."""

    topic: str
    peer: str
    alive: bool  # its liveliness token stands
    rate_ok: bool
    valid: bool  # the last message was good, and is not older than the topic allows
    rate_hz: float | None  # wall; None before the second message
    usual_hz: float | None  # wall; None: on occasion
    age_s: float | None  # wall, since the last message; None: never heard
    late_ms: float | None  # wall, from its time to its arrival here
    refused: int


@dataclass
class _Heard:
    boot: str = ""
    marks: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=64))  # wall, sequence
    late_s: float = math.nan
    refused_at: float = -math.inf
    refused: int = 0


class Vitals:
    """Grows by `heard` and `refused`. Wall times are seconds of any one clock."""

    def __init__(self, mission: Mission, began: float) -> None:
        self.listening: Container[str] = PERIODIC  # topics that are awaited, where those are subscribed to
        self._usual = _usual(mission)
        self._began = began
        self._streams: dict[tuple[str, str], _Heard] = {}
        self._latest: dict[str, float] = {}  # the greatest lateness since it was last told, s

    def __repr__(self) -> str:
        return f"Vitals({len(self._streams)} streams)"

    def heard(self, topic: str, message: Message, wall: float, late_s: float = math.nan) -> None:
        """A good message came; `late_s` is how long after its time, in wall seconds, if that is known."""
        stream = self._stream(topic, message.sender)
        marks = stream.marks
        if stream.boot != message.boot:
            stream.boot = message.boot
            marks.clear()
        if not marks or message.sequence > marks[-1][1]:
            marks.append((wall, message.sequence))
            while len(marks) > 2 and wall - marks[0][0] > WINDOW_S:
                marks.popleft()
        stream.late_s = late_s
        if topic in PROMPT and not math.isnan(late_s):
            self._latest[topic] = max(self._latest.get(topic, 0.0), late_s)

    def refused(self, topic: str, sender: str, wall: float) -> None:
        """A message came that is not applied."""
        stream = self._stream(topic, sender)
        stream.refused += 1
        stream.refused_at = wall

    def streams(self, wall: float, speed: float, peers: Mapping[str, str]) -> list[Stream]:
        """All that was heard, and what should have been: `peers` are those alive, id -> role.

        `speed` is team seconds per wall second.
        """
        wanted = {
            (topic, peer)
            for peer, role in peers.items()
            if role in ROLES
            for topic in PERIODIC
            if topic in ROLES[role].says and topic in self.listening
        }
        return [
            self._row(topic, peer, wall, speed, peer in peers)
            for topic, peer in sorted(wanted | set(self._streams))
        ]

    def gauges(self, wall: float, speed: float, peers: Mapping[str, str]) -> dict[str, float]:
        """For health, of topics that were heard: the greatest lateness since the last call, and how many live
        peers are not heard as they should be."""
        heard = {topic for topic, _ in self._streams}
        made = {f"late_ms.{topic}": 1e3 * late for topic, late in self._latest.items()}
        self._latest.clear()
        for peer, role in peers.items():
            if role not in ("robot", "fusion"):
                continue
            for topic in PERIODIC:
                if topic in heard and topic in ROLES[role].says:
                    row = self._row(topic, peer, wall, speed, True)
                    if not (row.rate_ok and row.valid):
                        made[f"silent.{topic}"] = made.get(f"silent.{topic}", 0.0) + 1.0
        return made

    def _stream(self, topic: str, sender: str) -> _Heard:
        key = (topic, sender)
        if key not in self._streams and len(self._streams) >= 100_000:
            key = (topic, "others")  # somebody makes names up
        return self._streams.setdefault(key, _Heard())

    def _row(self, topic: str, peer: str, wall: float, speed: float, alive: bool) -> Stream:
        stream = self._streams.get((topic, peer), _Heard())
        usual = self._usual.get((topic, peer), self._usual.get((topic, "")))
        usual = None if usual is None else usual * speed
        marks = stream.marks
        age = wall - marks[-1][0] if marks else None
        silent_s = wall - self._began if age is None else age
        rate = None
        if len(marks) > 1 and marks[-1][0] > marks[0][0]:
            rate = (marks[-1][1] - marks[0][1]) / (marks[-1][0] - marks[0][0])
        rate_ok = usual is None or (
            silent_s <= max(MISSED / usual, LEAST_S)
            and (rate is None or marks[-1][0] - marks[0][0] < LEAST_S or rate >= ENOUGH * usual)
        )
        stale = TOPICS[topic].stale_after_s if topic in TOPICS else 0.0
        fresh = not stale or age is None or age * speed <= stale
        good = not marks or stream.refused_at < marks[-1][0]
        if not marks and stream.refused:
            good = False
        late = None if math.isnan(stream.late_s) else 1e3 * stream.late_s
        return Stream(topic, peer, alive, rate_ok, fresh and good, rate, usual, age, late, stream.refused)


def _usual(mission: Mission) -> dict[tuple[str, str], float]:
    """Messages per team second, by topic and peer; peer "" is anybody."""
    usual = {(name, ""): TOPICS[name].rate_hz for name in PERIODIC if name != "set"}
    usual["pose", ""] = 1.0 / mission.settings.pose_period_s
    usual["picture", ""] = usual["posterior", ""] = 1.0 / mission.fusion.picture_period_s
    if not mission.trigger.enabled:
        for robot in mission.robots:
            period = robot.sensor.get("period_s")
            if isinstance(period, int | float) and period > 0:
                usual["set", robot.id] = 1.0 / period
    return usual
