"""The seam between the pure agents and their two drivers.

An agent is a state machine: `step(now, ..., events) -> actions`, woken at `next_wake()` or when an event
comes. It reads no clock, opens no socket and starts no thread. The process shell (agents.process.shell) and
the virtual-time engine (sim.engine.engine) run the same objects, so what is shown in one holds in the other.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypedDict

from agents.ledger.history import Checkpoint, Identity, Key
from agents.wire.messages import LedgerEntry, Message
from agents.wire.topics import Topic
from agents.wire.transport import PeerChange
from estimator.arrays import FloatArray
from planner.plan import Plan, PlanProblem, Trajectory


@dataclass(frozen=True, slots=True)
class Heard:
    """A decoded message of another process."""

    topic: Topic
    message: Message


@dataclass(frozen=True, slots=True)
class Measured:
    """The measurement set that a `Measure` action asked for."""

    capture_time: float
    pose: FloatArray  # (4,) of the robot at the capture time
    measurements: FloatArray  # (m, s)
    next_capture: float | None  # when the device will have its next set; None: whenever it is asked


@dataclass(frozen=True, slots=True)
class Planned:
    """The answer to a `RequestPlan` action."""

    number: int
    plan: Plan


@dataclass(frozen=True, slots=True)
class Delayed:
    """The vehicle was turned aside to keep apart from others: its trajectory is not true any more."""


@dataclass(frozen=True, slots=True)
class ClockTrust:
    """Whether the clock is near enough to the team's to take capture times from it; it is until told so."""

    trusted: bool


@dataclass(frozen=True, slots=True)
class Reckoned:
    """The work of a `Reckon` action is done."""

    number: int


Event = Reckoned | Heard | Measured | Planned | PeerChange | Delayed | ClockTrust


@dataclass(frozen=True, slots=True)
class Publish:
    """Send a message to the team."""

    topic: Topic
    message: Message


@dataclass(frozen=True, slots=True)
class Follow:
    """Give the vehicle a trajectory, to be begun at its start_time; None: hold."""

    trajectory: Trajectory | None


@dataclass(frozen=True, slots=True)
class Measure:
    """Take a measurement set that was due at `deadline`."""

    deadline: float


@dataclass(frozen=True, slots=True)
class RequestPlan:
    """Solve this problem away from the loop; the answer comes back as `Planned`."""

    number: int
    problem: PlanProblem


@dataclass(frozen=True, slots=True)
class Store:
    """Make these durable before any action after this one is carried out."""

    entries: Sequence[LedgerEntry]
    expired: Mapping[Identity, str] = field(default_factory=dict)  # those of them that do not apply, and why
    revived: Sequence[Identity] = ()  # stored before as expired; apply from now on


@dataclass(frozen=True, slots=True)
class Keep:
    """Make a state durable, so that a restart is quick; of older ones those of `kept` are still wanted."""

    checkpoint: Checkpoint
    kept: Sequence[Key]


@dataclass(frozen=True, slots=True)
class Release:
    """A fusion has these of what was stored (boot, sequence): they need not be kept here any more."""

    places: Sequence[tuple[str, int]]


@dataclass(frozen=True, slots=True)
class Reckon:
    """Do this away from the loop; what it changes is not touched until it comes back as `Reckoned`."""

    number: int
    work: Callable[[], None]


Action = Release | Reckon | Publish | Follow | Measure | RequestPlan | Store | Keep


class Header(TypedDict):
    """Spread into a message's constructor."""

    team: str
    sender: str
    boot: str
    sequence: int
    time: float


@dataclass
class Stamp:
    """The header of everything one process sends; sequences count per topic."""

    team: str
    sender: str
    boot: str
    _next: dict[str, int] = field(default_factory=dict)

    def header(self, topic: Topic, time: float) -> Header:
        """The next header of a topic."""
        sequence = self._next.get(topic.name, 0)
        self._next[topic.name] = sequence + 1
        return Header(team=self.team, sender=self.sender, boot=self.boot, sequence=sequence, time=time)

    def sent(self, topic: Topic) -> int:
        """How many messages of a topic were stamped."""
        return self._next.get(topic.name, 0)
