"""How a whole team is, as one process hears it: for `searchparty status`, the terminal and the viewer."""

import math
from collections.abc import Iterable
from typing import TypeVar

import msgspec

from agents.health.vitals import Stream, Vitals
from agents.mission.mission import Mission
from agents.wire.messages import HealthMessage, Message, PosteriorMessage
from agents.wire.transport import PeerChange

T = TypeVar("T", int, float)
LOOK_S = 1.0  # wall time


class TopicHealth(msgspec.Struct, frozen=True, kw_only=True):
    """One topic of one process as it is heard here."""

    alive: bool
    rate_ok: bool
    valid: bool
    rate_hz: float | None
    usual_hz: float | None
    age_s: float | None
    late_ms: float | None
    refused: int


class ProcessHealth(msgspec.Struct, frozen=True, kw_only=True):
    """One process: as it is heard here, and what it says of itself."""

    role: str
    id: str
    alive: bool
    boots: list[str]  # alive ones; more than one: two processes of one id
    state: str
    memory_mb: float | None
    clock: dict[str, float]  # offset_ms, error_ms, corrected_ms, age_s
    queues: dict[str, int]  # messages that wait, by topic
    dropped: dict[str, int]  # that a full queue gave up, by topic
    rejected: dict[str, int]  # not applied, by reason
    lost: int
    late_ms: dict[str, float]  # the greatest lateness of the last second as it hears, by topic
    silent: dict[str, int]  # live peers that it does not hear as it should, by topic
    topics: dict[str, TopicHealth]
    vehicle: str  # a real one in words; else ""
    telemetry: dict[str, float]  # a real one's gauges: battery, fix, link_quality, clock_offset, ...


class TeamHealth(msgspec.Struct, frozen=True, kw_only=True):
    """The whole team."""

    mission: str
    team: str
    time_s: float | None  # team time; None: no fusion said what time it is
    healthy: bool
    problems: list[str]
    sets_applied: int | None
    found: int | None
    processes: list[ProcessHealth]


class HealthBoard:
    """Hears the team. Wall times are seconds of any one clock."""

    def __init__(self, mission: Mission, vitals: Vitals) -> None:
        self._mission = mission
        self._vitals = vitals
        self._roles = {robot.id: "robot" for robot in mission.robots}
        self._boots: dict[str, dict[str, None]] = {}  # alive, by process, in the order of their coming
        self._first: dict[tuple[str, str], HealthMessage] = {}
        self._last: dict[str, HealthMessage] = {}
        self._posterior: PosteriorMessage | None = None
        self._look_at = -math.inf
        self._recent: tuple[str, ...] = ()
        self.warnings: list[str] = []  # what the user of the board knows besides

    def __repr__(self) -> str:
        return f"HealthBoard({len(self._roles)} processes)"

    @property
    def peers(self) -> dict[str, str]:
        """Those alive: id -> role."""
        return {name: self._roles[name] for name, boots in self._boots.items() if boots}

    def on_peer(self, change: PeerChange) -> None:
        """A liveliness token came or went."""
        peer = change.peer
        self._roles[peer.id] = peer.role
        boots = self._boots.setdefault(peer.id, {})
        if change.alive:
            boots[peer.boot] = None
        else:
            boots.pop(peer.boot, None)

    def on_message(self, message: Message) -> None:
        """A good message of any topic; the vitals are told by who heard it."""
        if isinstance(message, HealthMessage):
            self._first.setdefault((message.sender, message.boot), message)
            self._last[message.sender] = message
            self._roles.setdefault(message.sender, message.role)
        elif isinstance(message, PosteriorMessage) and (
            self._posterior is None or message.applied >= self._posterior.applied
        ):
            self._posterior = message

    def recent(self, wall: float, speed: float) -> tuple[str, ...]:
        """What is wrong, looked at no more than once a second."""
        if wall >= self._look_at:
            self._look_at = wall + LOOK_S
            self._recent = tuple(self.report(wall, speed, None).problems)
        return self._recent

    def report(self, wall: float, speed: float, team_time: float | None) -> TeamHealth:
        """How the team stands at wall time `wall`; `speed` is team seconds per wall second."""
        by_peer: dict[str, dict[str, TopicHealth]] = {}
        streams = self._vitals.streams(wall, speed, self.peers)
        for s in streams:
            row = TopicHealth(**{name: getattr(s, name) for name in TopicHealth.__struct_fields__})
            by_peer.setdefault(s.peer, {})[s.topic] = row
        processes = [self._process(name, by_peer.get(name, {})) for name in self._roles]
        problems = [*self.warnings, *self._problems(processes), *_stream_problems(streams)]
        posterior = self._posterior
        return TeamHealth(
            mission=self._mission.name,
            team=self._mission.team,
            time_s=team_time,
            healthy=not problems,
            problems=problems,
            sets_applied=None if posterior is None else posterior.applied,
            found=None if posterior is None else posterior.found.shape[1],
            processes=processes,
        )

    def _process(self, name: str, topics: dict[str, TopicHealth]) -> ProcessHealth:
        message = self._last.get(name)
        counters = {} if message is None else message.counters
        gauges = {} if message is None else message.gauges
        return ProcessHealth(
            role=self._roles[name],
            id=name,
            alive=bool(self._boots.get(name)),
            boots=list(self._boots.get(name, {})),
            state="" if message is None else message.state,
            memory_mb=gauges.get("memory_mb"),
            clock=_under(gauges, "clock_"),
            queues={topic: int(n) for topic, n in _under(gauges, "queue.").items()},
            dropped={topic: n for topic, n in _under(counters, "link.dropped.").items() if n},
            rejected=_under(counters, "rejected."),
            lost=counters.get("lost", 0),
            late_ms=_under(gauges, "late_ms."),
            silent={topic: int(n) for topic, n in _under(gauges, "silent.").items()},
            topics=topics,
            vehicle="" if message is None else message.vehicle,
            telemetry=_under(gauges, "mavlink."),
        )

    def _problems(self, processes: Iterable[ProcessHealth]) -> list[str]:
        found = []
        if not any(p.alive and p.role == "fusion" for p in processes):
            found.append("no fusion is alive: robots go on with what they know")
        for p in processes:
            if p.role == "robot" and not p.alive:
                found.append(f"robot {p.id} is not there")
            if len(p.boots) > 1 and p.role in ("robot", "fusion"):
                found.append(f"{len(p.boots)} processes are {p.role} {p.id}: {', '.join(p.boots)}")
            found += self._growing(p)
            if p.alive and p.telemetry.get("trouble"):
                found.append(f"the vehicle of {p.id}: {p.vehicle}")
            off = p.clock.get("offset_ms", 0.0) - p.clock.get("corrected_ms", 0.0)
            if abs(off) > max(2.0 * p.clock.get("error_ms", 0.0), 1e3):
                found.append(f"the clock of {p.id} is {off / 1e3:+.1f} s off and not corrected")
        return found

    def _growing(self, p: ProcessHealth) -> list[str]:
        """What got worse since this board first heard of the process."""
        message = self._last.get(p.id)
        first = None if message is None else self._first.get((message.sender, message.boot))
        if message is None or first is None or not p.alive:
            return []
        worse = {
            name: value - first.counters.get(name, 0)
            for name, value in message.counters.items()
            if name.startswith(("rejected.", "link.dropped."))
        }
        words = {"rejected": "refused {n} messages ({what})", "link": "dropped {n} messages of {what}"}
        return [
            f"{p.id} " + words[name.split(".")[0]].format(n=n, what=name.split(".")[-1])
            for name, n in sorted(worse.items())
            if n > 0
        ]


def _stream_problems(streams: Iterable[Stream]) -> list[str]:
    found = []
    for s in streams:
        if not s.alive:
            continue  # which is said once, of the process
        if not s.rate_ok:
            rate = "nothing" if s.rate_hz is None or (s.age_s or 0.0) > 2.5 else f"{s.rate_hz:.1f} Hz"
            found.append(f"{s.peer} says {rate} on {s.topic}, usual is {s.usual_hz:.1f} Hz")
        elif not s.valid:
            why = f"{s.refused} refused" if s.refused else "too old"
            found.append(f"what {s.peer} says on {s.topic} is not used: {why}")
    return found


def _under(table: dict[str, T], prefix: str) -> dict[str, T]:
    return {name.removeprefix(prefix): value for name, value in table.items() if name.startswith(prefix)}
