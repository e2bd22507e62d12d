"""A robot that hears no fusion goes on with an estimate of its own.

It begins with the last state that a fusion shared (bit for bit, agents.ledger.snapshot) and applies every set
that it took or heard and that is not in there: its own, and those of all peers in its reach. Entries are
known by (robot, boot, sequence) and counted once, so nothing is counted twice, whoever sends it again; and
only entries are ever applied, never what another robot made of them. What it believes it tells people (topic
belief), and nobody else takes it. Its own sets go on to wait for a fusion; when one is back it gets them from
the robots themselves, and the robot's estimate is dropped as soon as a posterior holds at least as much.

While a fusion is heard this costs the memory of one state and of some sets. Filtering is done away from the
loop (`Reckon`), and only while no fusion is heard.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from agents.errors import DataError
from agents.fusion.estimate import SLICE, Estimate
from agents.fusion.posterior import estimated, picture
from agents.fusion.watermark import Applied, covers, source
from agents.ledger.history import identity, key
from agents.ledger.snapshot import Snapshots
from agents.machine import Action, Publish, Reckon, Stamp
from agents.mission.mission import Mission
from agents.robot.belief import Belief
from agents.wire.messages import (
    BeliefMessage,
    EventMessage,
    LedgerEntry,
    MeasurementSetMessage,
    PosteriorMessage,
    StateMessage,
)
from agents.wire.topics import BELIEF, EVENT, PICTURE
from estimator.search import Search
from estimator.sensor import SensorModel

MOST = 10_000  # sets kept that no shared state holds; the oldest go first
GATHER_S = 0.25  # sets that come within this are applied together


@dataclass(frozen=True, slots=True)
class AloneSetup:
    """What a robot's own estimate is made with; the same as a fusion's."""

    mission: Mission
    search: Search[Any]
    sensors: Mapping[str, SensorModel]
    seed: int
    fingerprint: str = ""


class Alone:
    """Hears what the robot hears. `step` says what to do, and what to believe meanwhile."""

    def __init__(self, setup: AloneSetup, robot: str, now: float, patience: float = 1.0) -> None:
        self._setup = setup
        self._robot = robot
        table = setup.mission.fusion
        self._after = table.alone_after_s * max(1.0, patience)
        self._period = table.picture_period_s * max(1.0, patience)
        self._gather = GATHER_S * max(1.0, patience)
        self._heard_at = now  # of a posterior
        self._back_at: float | None = None  # since when a fusion is heard again
        self._shared: StateMessage | None = None
        self._kept: deque[LedgerEntry] = deque(maxlen=MOST)  # since the shared state; some may come twice
        self._estimate: Estimate | None = None
        self._fresh: list[LedgerEntry] = []  # not yet given to the estimate
        self._reckoning: int | None = None
        self._number = 0
        self._reckon_at = 0.0
        self._tell_at = 0.0
        self._said = False
        self.began = 0  # how often
        self._own = Stamp(setup.mission.team, robot, "alone")  # of what only this robot sees
        self._view: BeliefMessage | None = None  # of the estimate, since the last look
        self._shown = False  # to the robot's belief

    def __repr__(self) -> str:
        return f"Alone({self._robot}, alone={self.alone}, kept={len(self._kept)}, {self._estimate})"

    @property
    def alone(self) -> bool:
        """Whether the robot goes by its own estimate, or is making it."""
        return self._estimate is not None

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        if self._estimate is None:
            return self._heard_at + self._after
        if self._reckoning is not None:
            return float("inf")  # its end is an event
        return min(self._tell_at, self._reckon_at) if self._fresh else self._tell_at

    # What the robot hears

    def hear_posterior(self, now: float, message: PosteriorMessage) -> None:
        """A fusion is there."""
        if self._back_at is None or now - self._heard_at >= self._after:
            self._back_at = now
        self._heard_at = now
        estimate = self._estimate
        if estimate is None or self._reckoning is not None:
            return
        # One that lets sets expire may never hold as many: then it is believed when it has stayed.
        if message.applied >= estimate.sets or now - self._back_at >= self._after:
            self._estimate, self._view = None, None
            self._fresh.clear()

    def hear_state(self, message: StateMessage) -> None:
        """A fusion shares its state: what it holds need not be kept any more."""
        if self._shared is None or message.applied >= self._shared.applied:
            self._shared = message
            self._kept = deque(filter(self._is_news, self._kept), MOST)

    def hear(self, entry: LedgerEntry) -> None:
        """A set or statement that this robot or a peer took; while a fusion is heard it is only kept."""
        self._kept.append(entry)
        if self._estimate is not None and self._is_news(entry):
            self._fresh.append(entry)

    def _is_news(self, entry: LedgerEntry) -> bool:
        """Whether an entry is good, and not in the shared state."""
        if isinstance(entry, MeasurementSetMessage):
            sensor = self._setup.sensors.get(entry.sender)
            if sensor is None or entry.measurements.shape[1] != sensor.measurement_size:
                return False
        shared = self._shared
        name = source(entry.sender, entry.boot)
        return shared is None or not covers(shared.watermark.get(name), entry.sequence)

    # What it does

    def reckoned(self, number: int) -> None:
        """The work of a `Reckon` is done."""
        if number == self._reckoning:
            self._reckoning = None
            self._show()

    def step(self, now: float, stamp: Stamp, belief: Belief) -> list[Action]:
        """What to do at `now`; the robot's belief is given what to believe."""
        silent = now >= self._heard_at + self._after  # as `next_wake` reckons, to the last bit
        if self._estimate is not None:
            return self._go_on(now, stamp, belief)
        if self._shown:
            self._shown = False
            belief.forget_posterior(self._robot, now)
        if silent:
            self._said = True
            text = f"{self._robot} hears no fusion: it goes on with the sets that it knows"
            return [self._begin(now), self._event(now, stamp, "warning", text)]
        if self._said:
            self._said = False
            return [self._event(now, stamp, "info", f"{self._robot} hears a fusion again")]
        return []

    def _go_on(self, now: float, stamp: Stamp, belief: Belief) -> list[Action]:
        estimate, actions = self._estimate, list[Action]()
        assert estimate is not None
        if self._reckoning is not None:
            return actions
        if self._view is not None:
            belief.hear_posterior(self._view, now)
            self._shown = True
        if self._view is not None and now >= self._tell_at:
            self._tell_at = now + self._period
            header = self._own.header(PICTURE, estimate.state.time)
            belief.hear_picture(picture(self._setup.search, estimate.state, header))
            told = msgspec.structs.replace(self._view, **stamp.header(BELIEF, self._view.time))
            actions.append(Publish(BELIEF, told))
        if self._fresh and now >= self._reckon_at:
            entries = sorted({identity(e): e for e in self._fresh}.values(), key=key)
            self._fresh = []
            actions.append(self._work(now, partial(_accept, estimate, entries)))
        return actions

    def _begin(self, now: float) -> Action:
        setup, shared = self._setup, self._shared
        entries = sorted({identity(e): e for e in self._kept if self._is_news(e)}.values(), key=key)
        estimate = Estimate(
            setup.search, setup.sensors, setup.seed, rollback_s=setup.mission.fusion.rollback_s
        )
        self._estimate, self._fresh = estimate, []
        self._back_at = None
        self.began += 1
        self._tell_at = now

        def work() -> None:
            if shared is not None:
                try:
                    state = Snapshots(estimate.initial, setup.fingerprint).decode(shared.state)
                    estimate.begin_at(state, Applied(shared.watermark), shared.applied)
                except DataError:  # of other code than this robot's: what it heard itself must do
                    pass
            _accept(estimate, entries)

        return self._work(now, work)

    def _work(self, now: float, work: Callable[[], None]) -> Reckon:
        self._number += 1
        self._reckoning = self._number
        self._reckon_at = now + self._gather
        return Reckon(self._number, work)

    def _show(self) -> None:
        """Take over what the estimate says now."""
        estimate = self._estimate
        if estimate is not None:
            header = self._own.header(BELIEF, estimate.state.time)
            view = estimated(self._setup.search, estimate.state)
            self._view = BeliefMessage(**header, **view, applied=estimate.sets)

    def _event(self, now: float, stamp: Stamp, level: str, text: str) -> Action:
        return Publish(EVENT, EventMessage(**stamp.header(EVENT, now), level=level, text=text))


def _accept(estimate: Estimate, entries: Sequence[LedgerEntry]) -> None:
    """Take in those that are new to the estimate, by growing key."""
    for i in range(0, len(entries), SLICE):  # what was let go of meanwhile is not kept in memory
        estimate.accept([entry for entry in entries[i : i + SLICE] if not estimate.holds(entry)])
