"""What a watcher knows of the team from messages alone: the snapshot for the terminal's table."""

from agents.fusion.watermark import counted
from agents.mission.mission import Mission
from agents.swarm.shown import Shown
from agents.swarm.status_table import ProcessStatus, TeamStatus
from agents.wire.messages import (
    EstimateMessage,
    EventMessage,
    HealthMessage,
    Message,
    PoseMessage,
    PosteriorMessage,
    TruthMessage,
    Watermark,
)
from agents.wire.topics import SET
from agents.wire.transport import PeerChange

_SILENCE_S = 3.0  # wall time without a posterior after which a robot's belief is shown


class StatusBoard:
    """Hears the team; `status` tells how it stands. Wall times are seconds of any one clock."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._roles = {robot.id: "robot" for robot in mission.robots}
        self._alive: dict[str, set[str]] = {}  # boots whose token stands, by process
        self._boots: dict[str, set[str]] = {}  # all that were ever heard of
        self._heard: dict[str, float] = {}
        self._states: dict[str, str] = {}
        self._poses: dict[str, PoseMessage] = {}
        self._sets: dict[tuple[str, str], int] = {}  # sets sent, by process and boot
        self._rejected: dict[str, int] = {}
        self._twice: dict[str, float] = {}  # task-seconds that another held one of its tasks too
        self._vehicles: dict[str, str] = {}  # real ones, in words
        self._tasks: dict[str, float | None] = {}  # how many a process holds, where robots share tasks
        self._shown = Shown(_SILENCE_S)
        self._marks: dict[str, Watermark] = {}  # by boot: a posterior need not tell of those that ended
        self._total: int | None = None
        self._note = ""

    def __repr__(self) -> str:
        return f"StatusBoard({len(self._roles)} processes, {self._shown!r})"

    def on_peer(self, change: PeerChange) -> None:
        """A liveliness token came or went."""
        peer = change.peer
        if peer.role not in ("robot", "fusion"):
            return
        self._roles[peer.id] = peer.role
        self._boots.setdefault(peer.id, set()).add(peer.boot)
        boots = self._alive.setdefault(peer.id, set())
        (boots.add if change.alive else boots.discard)(peer.boot)
        if not change.alive and not boots:
            self._note = f"{peer.role} {peer.id} is gone"

    def on_message(self, topic_name: str, message: Message, wall: float) -> None:
        """Take in a message that came at wall time `wall`."""
        sender = message.sender
        self._heard[sender] = wall
        match message:
            case PoseMessage():
                self._poses[sender] = message
                self._states[sender] = message.state
            case HealthMessage():
                self._vehicles[sender] = message.vehicle
                self._tasks[sender] = message.gauges.get("tasks_owned")
                self._twice[sender] = message.gauges.get("double_owned_s", 0.0)
                self._rejected[sender] = message.counters.get("rejected", 0)
                if sender not in self._poses:
                    self._states[sender] = message.state
            case EstimateMessage():
                self._shown.hear(message, wall)
                if isinstance(message, PosteriorMessage):
                    for name, mark in message.watermark.items():
                        if name not in self._marks or counted(mark) >= counted(self._marks[name]):
                            self._marks[name] = mark
            case TruthMessage():
                self._total = message.targets.shape[1]
            case EventMessage():
                self._note = f"{sender}: {message.text}"
        if topic_name == SET.name:
            stream = (sender, message.boot)
            self._sets[stream] = max(self._sets.get(stream, 0), message.sequence + 1)

    def note(self, text: str) -> None:
        """A line of the watcher's own."""
        self._note = text

    def status(self, wall: float, team_time: float | None) -> TeamStatus:
        """How the team stands at wall time `wall`."""
        posterior = self._shown.estimate
        return TeamStatus(
            mission=self._mission.name,
            time_s=team_time,
            duration_s=self._mission.duration_s,
            found=0 if posterior is None else posterior.found.shape[1],
            total=self._total,
            expected_cardinality=None if posterior is None else posterior.expected_cardinality,
            sets_applied=0 if posterior is None else posterior.applied,
            rejected=sum(self._rejected.values()),
            held_twice_s=sum(self._twice.values()),
            processes=tuple(self._row(name, wall) for name in self._roles),
            note=self._note,
            alone=self._shown.alone,
        )

    def _row(self, name: str, wall: float) -> ProcessStatus:
        role = self._roles[name]
        boots = self._boots.get(name, set())
        return ProcessStatus(
            role=role,
            id=name,
            state=self._states.get(name, "not heard yet" if not boots else ""),
            # Who was never there is awaited, not gone.
            alive=bool(self._alive.get(name)) or not boots,
            age_s=wall - self._heard[name] if name in self._heard else None,
            sets_sent=sum(n for (sender, _), n in self._sets.items() if sender == name)
            if role == "robot"
            else None,
            sets_stored=self._stored(name, role),
            tasks=None if (held := self._tasks.get(name)) is None else int(held),
            travelled_m=self._poses[name].travelled if name in self._poses else None,
            restarts=max(0, len(boots) - 1),
            vehicle=self._vehicles.get(name, ""),
        )

    def _stored(self, name: str, role: str) -> int | None:
        estimate = self._shown.estimate
        if estimate is None:
            return None
        if role == "fusion":
            return estimate.applied
        return sum(counted(mark) for stream, mark in self._marks.items() if stream.startswith(f"{name}/"))
