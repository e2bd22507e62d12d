"""The Fusion: applies the ledger to the filter and says what the team believes.

A state machine like the Robot. Measurement sets and operators' soft observations are applied in the order
(capture time, sender, boot, sequence), each once, late ones in their places (agents.fusion.estimate). The
posterior is a function of the set of entries alone: the generator of each entry's draws is seeded by the
entry's own identity. So any number of fusions may run, and one that starts again goes on as if it had never
died.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from agents.fusion.admission import Admission, about
from agents.fusion.estimate import Estimate, Mark, kind
from agents.fusion.posterior import estimated, picture
from agents.fusion.replicas import PERIOD_S, Replicas, opened
from agents.fusion.watermark import source
from agents.ledger.history import Checkpoint, History, Identity, identity, key
from agents.ledger.snapshot import Snapshots
from agents.machine import Action, Event, Heard, Keep, Publish, Stamp, Store
from agents.mission.mission import Mission
from agents.operator.statements import words
from agents.wire.messages import (
    EventMessage,
    LedgerEntry,
    LedgerMessage,
    PosteriorMessage,
    RelayMessage,
    SoftObservationMessage,
    StateMessage,
)
from agents.wire.topics import EVENT, LEDGER, PICTURE, POSTERIOR, RELAY, STATE
from agents.wire.transport import PeerChange
from estimator.search import Search, SearchState
from estimator.sensor import SensorModel


@dataclass(frozen=True, slots=True)
class FusionSetup:
    """What a fusion is made with."""

    mission: Mission
    id: str
    boot: str
    search: Search[Any]
    sensors: Mapping[str, SensorModel]
    history: History | None = None  # where its `Store` actions end up; None: what is very late comes last
    fingerprint: str = ""  # of what makes states the same, see agents.ledger.snapshot
    host: str = ""  # checkpoints of another are not bit for bit what this one would have


class Fusion:
    """The team's estimate. `step` is the only way in; `restore` takes over what its ledger holds first."""

    def __init__(self, setup: FusionSetup, seed: int) -> None:
        mission = setup.mission
        self.id = setup.id
        self.stamp = Stamp(mission.team, setup.id, setup.boot)
        self._mission = mission
        self._search = setup.search
        self._history = setup.history
        self._estimate = Estimate(
            setup.search,
            setup.sensors,
            seed,
            rollback_s=mission.fusion.rollback_s,
            late=mission.fusion.late_sets,
            history=setup.history,
        )
        initial = self._estimate.initial
        self._shared = Snapshots(initial, setup.fingerprint)  # with robots on whatever hosts
        self._snapshots = Snapshots(initial, setup.fingerprint + setup.host)
        self._admission = Admission(mission, setup.search, setup.sensors, self.counters)
        self.replicas = Replicas(setup.id, mission.fusions())
        self._picture_at = 0.0
        self._told_at = 0.0
        self._shared_at = 0.0
        self._found = 0

    def __repr__(self) -> str:
        return f"Fusion({self.id}, {self._estimate!r}, found={self._found}, {dict(self.counters)})"

    @property
    def estimate(self) -> Estimate:
        """What it grows."""
        return self._estimate

    @property
    def counters(self) -> Counter[str]:
        """For health; they only grow."""
        return self._estimate.counters

    @property
    def search_state(self) -> SearchState[Any]:
        """The estimate after everything applied."""
        return self._estimate.state

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        if self._estimate.settling:
            return 0.0  # there is work to do: at once
        times = [self._picture_at]
        if self.replicas.any and self._history is not None:
            times.append(self._told_at)
        return min(times)

    def restore(self) -> None:
        """Go on where the ledger's earlier life ended."""
        assert self._history is not None, "restore needs a ledger"
        load = self._snapshots.decode
        marks = [Mark(c.key, c.entries, partial(load, c.payload)) for c in self._history.checkpoints()]
        self._estimate.resume(self._history, marks)
        self._found = self.search_state.found.shape[1]

    def step(self, now: float, events: Sequence[Event]) -> list[Action]:
        """Take in what happened up to `now`; answer what to store and to publish, in order."""
        estimate = self._estimate
        actions: list[Action] = []
        changed = estimate.settle()
        new: dict[Identity, LedgerEntry] = {}
        for event in events:
            if isinstance(event, PeerChange):
                self.replicas.notice(event)
            elif not isinstance(event, Heard):
                continue
            elif isinstance(event.message, LedgerEntry):
                actions += self._offered(now, [event.message], new)
            elif isinstance(event.message, RelayMessage):
                entries, refused = opened(event.message)
                self.counters.update(f"rejected.{reason}" for reason in refused)
                actions += self._offered(now, entries, new)
            elif isinstance(event.message, LedgerMessage):
                actions += self._compared(now, event.message)
                changed |= not estimate.settling
        if new:
            actions += self._taken(now, sorted(new.values(), key=key))
        if new or changed:
            actions.append(Publish(POSTERIOR, self._posterior()))
            actions += self._announce(now)
        actions += self._on_time(now, told=bool(new) or changed)
        return actions

    # What comes in

    def _offered(
        self, now: float, entries: Iterable[LedgerEntry], new: dict[Identity, LedgerEntry]
    ) -> Iterable[Action]:
        """Add those to `new` that are; some of the others get an answer."""
        estimate = self._estimate
        for entry in entries:
            if identity(entry) in new or estimate.holds(entry):
                self.counters[f"duplicate_{kind(entry)}"] += 1
                estimate.applied.asked(source(entry.sender, entry.boot))
                continue
            refusal = self._admission.refusal(entry, now, estimate.state, estimate.statements)
            if refusal is None:
                new[identity(entry)] = entry
            elif refusal and isinstance(entry, SoftObservationMessage):
                yield self._answer(now, entry, f"refused: {refusal}")

    def _taken(self, now: float, entries: Sequence[LedgerEntry]) -> list[Action]:
        """Entries that came together are stored and shown together, each applied in its place."""
        expired = self._estimate.accept(entries)
        actions: list[Action] = [Store(entries, expired)]
        for entry in entries:
            if isinstance(entry, SoftObservationMessage):
                objection = "changes nothing: it came too late" if identity(entry) in expired else ""
                if identity(entry) in self._estimate.void:
                    objection = f"changes nothing: {self._estimate.void[identity(entry)]}"
                actions.append(self._answer(now, entry, objection))
        return actions

    def _compared(self, now: float, told: LedgerMessage) -> list[Action]:
        """What another fusion lacks is sent; what it applied and this one let expire is applied."""
        if self._history is None:
            return []
        difference = self.replicas.differences(now, told, self._estimate, self._history)
        self.counters["relayed"] += len(difference.relayed)
        actions: list[Action] = [
            Publish(RELAY, relay) for relay in self.replicas.relays(self.stamp, now, difference.relayed)
        ]
        if difference.revived:
            self._estimate.revive(difference.revived)
            actions.append(Store([], revived=[identity(entry) for entry in difference.revived]))
        return actions

    # What goes out

    def _on_time(self, now: float, *, told: bool) -> list[Action]:
        table = self._mission.fusion
        actions: list[Action] = []
        if now >= self._picture_at:
            self._picture_at = _next(self._picture_at, table.picture_period_s, now)
            header = self.stamp.header(PICTURE, self.search_state.time)
            actions.append(Publish(PICTURE, picture(self._search, self.search_state, header)))
            if not told:
                actions.append(Publish(POSTERIOR, self._posterior()))
        if table.share_state_s > 0.0 and now >= self._shared_at:
            self._shared_at = _next(self._shared_at, table.share_state_s, now)
            actions.append(Publish(STATE, self._state()))
        if self.replicas.any and self._history is not None and now >= self._told_at:
            self._told_at = _next(self._told_at, PERIOD_S, now)
            actions.append(Publish(LEDGER, self.replicas.told(self.stamp, now, self._estimate)))
        fresh, kept = self._estimate.take_marks()
        for mark in fresh:
            payload = self._snapshots.encode(mark.load())
            actions.append(Keep(Checkpoint(mark.key, mark.entries, payload), kept))
        return actions

    def _posterior(self) -> PosteriorMessage:
        state, estimate = self.search_state, self._estimate
        return PosteriorMessage(
            **self.stamp.header(POSTERIOR, state.time),
            **estimated(self._search, state),
            applied=estimate.sets,
            watermark=estimate.applied.watermarks(),
            expired=max(0, self.counters["expired_sets"]),
        )

    def _state(self) -> StateMessage:
        state, estimate = self.search_state, self._estimate
        return StateMessage(
            **self.stamp.header(STATE, state.time),
            watermark=estimate.applied.all(),
            applied=estimate.sets,
            state=self._shared.encode(state),
        )

    def _announce(self, now: float) -> list[Action]:
        found = self.search_state.found
        before, count = self._found, found.shape[1]
        self._found = count
        if count == before or not self.replicas.leads:
            return []
        text = f"{count} targets found"
        if count > before:
            where = "; ".join(
                "(" + ", ".join(f"{x:.1f}" for x in found[:, i]) + ")" for i in range(before, count)
            )
            text += f", the newest at {where}"
        return [Publish(EVENT, EventMessage(**self.stamp.header(EVENT, now), level="info", text=text))]

    def _answer(self, now: float, statement: SoftObservationMessage, objection: str) -> Action:
        """Tell people, and the operator, what was said and what became of it."""
        text = f"{statement.sender} says: {words(statement)}" + (f" ({objection})" if objection else "")
        header = self.stamp.header(EVENT, now)
        level = "warning" if objection else "info"
        return Publish(EVENT, EventMessage(**header, level=level, text=text, about=about(statement)))


def _next(due: float, period: float, now: float) -> float:
    """The first moment after `now` that lies a whole number of periods after `due`."""
    return due + period * (1 + max(0, int((now - due) / period)))
