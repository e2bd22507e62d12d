"""The estimate: a function of the set of entries it was given, in whatever order they came.

Entries apply in the order of their keys (capture time, sender, boot, sequence). Within the rollback window a
late one is put in its place at once (agents.fusion.timeline). One that belongs further back is put there too,
from the last mark before it: a mark is the state after everything up to a key. What lies behind it is read
from the ledger and applied again, SLICE entries a step, so that new sets need not wait; only then it counts
as applied. Where a mission would rather let such an entry expire, it is counted and changes nothing.

Fusions keep marks durable as checkpoints, and begin there after a restart. A robot that is on its own keeps
no ledger: there an entry from before the window is applied at the end.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from agents.errors import DataError
from agents.fusion.timeline import Arrival, Timeline
from agents.fusion.watermark import Applied, counted, source
from agents.ledger.history import History, Identity, Key, identity, key
from agents.operator.statements import observation
from agents.seeds import generator
from agents.wire.messages import LedgerEntry, MeasurementSetMessage, SoftObservationMessage
from estimator.search import Search, SearchState
from estimator.sensor import SensorModel

SLICE = 64  # entries that are applied again in one step
MARK_EVERY = 256  # applied entries from one mark to the next
MARKS = 16  # kept: close together for what was of late, ever wider apart before
LATE = "late"  # the reason why an entry expires

State = SearchState[Any]


@dataclass(frozen=True, slots=True)
class Mark:
    """The state after all entries up to a key."""

    key: Key
    entries: int  # in the state
    load: Callable[[], State]  # raises DataError if the state cannot be had


@dataclass(slots=True)
class _Rework:
    """On the way from a mark to the present."""

    key: Key | None  # everything up to here is in the state; None: nothing yet
    entries: int
    state: State


class Estimate:
    """Grows by `accept` and `settle`."""

    def __init__(
        self,
        search: Search[Any],
        sensors: Mapping[str, SensorModel],
        seed: int,
        *,
        rollback_s: float,
        late: Literal["apply", "expire"] = "apply",
        history: History | None = None,
    ) -> None:
        self.search = search
        self.applied = Applied()  # in the state, or expired
        self.expired = Applied()
        self.counters: Counter[str] = Counter()
        self.sets = 0  # in the state
        self.statements = 0
        self.void: dict[Identity, str] = {}  # statements that change nothing where they stand, and why
        self.initial = search.init(generator(seed, "fusion", "prior"))
        self._apply = partial(_apply, search, sensors, seed, self.void)
        self._timeline: Timeline[State, LedgerEntry] = Timeline(self.initial, self._apply, rollback_s)
        self._rollback_s = rollback_s
        self._late = late
        self._history = history
        self._pending: dict[Identity, tuple[Key, bool]] = {}  # not yet in the state; whether it is a set
        self._rework: _Rework | None = None
        self._redone = 0
        self._base_entries = 0  # in the state that the timeline was given to begin with
        self._marks: list[Mark] = []
        self._unsaved: list[Mark] = []

    def __repr__(self) -> str:
        return f"Estimate(applied={self.sets}, pending={len(self._pending)}, marks={len(self._marks)})"

    @property
    def state(self) -> State:
        """After everything applied."""
        return self._timeline.state

    @property
    def settling(self) -> bool:
        """Whether late entries are on their way to their places: `settle` has something to do."""
        return bool(self._pending)

    def holds(self, entry: LedgerEntry) -> bool:
        """Whether an entry was accepted before."""
        return entry in self.applied or identity(entry) in self._pending

    def begin_at(self, state: State, applied: Applied, sets: int) -> None:
        """Go on from another's state, in which these entries are; nothing can be put in a place before it."""
        self._timeline.rebase(state, (state.time, "", "", 0))
        self.applied, self.sets = applied, sets

    def accept(self, entries: Sequence[LedgerEntry]) -> dict[Identity, str]:
        """Take in entries, by growing key, none of which it `holds`; those that expired, and why.

        What lies behind the place of the first is applied again only once.
        """
        timeline = self._timeline
        items: list[tuple[Key, LedgerEntry]] = []
        expired: dict[Identity, str] = {}
        for entry in entries:
            place = key(entry)
            if self._late == "expire" and timeline.too_late(place):
                expired[identity(entry)] = LATE
                self.expired.add(entry)
                self.applied.add(entry)
                self.counters[f"expired_{kind(entry)}"] += 1
            elif timeline.let_go(place):
                self.counters[f"late_{kind(entry)}"] += 1
                self._put_back(entry)
            else:
                self._count(entry)
                items.append((place, entry))
        for (_, entry), arrival in zip(items, timeline.insert_all(items), strict=True):
            self.counters[f"late_{kind(entry)}"] += arrival is not Arrival.IN_ORDER
        self._look_back()
        self._update_counters()
        return expired

    def revive(self, entries: Sequence[LedgerEntry]) -> None:
        """Apply entries, by growing key, that had expired: another fusion of the team had them in time."""
        items = []
        for entry in entries:
            self.expired.remove(entry)
            self.counters[f"expired_{kind(entry)}"] -= 1
            self.counters[f"revived_{kind(entry)}"] += 1
            if self._timeline.let_go(key(entry)):
                self._put_back(entry)
            else:
                self._count(entry)
                items.append((key(entry), entry))
        self._timeline.insert_all(items)
        self._update_counters()

    def settle(self) -> bool:
        """Go on towards the places of late entries, which are stored by now; True when all are there."""
        if not self._pending or self._history is None:
            return False
        horizon = self._timeline.horizon
        work = self._rework or self._begin_rework()
        batch = self._history.between(work.key, horizon, SLICE)
        for entry in batch:
            work.state = self._apply(work.state, entry)
        self._redone += len(batch)
        if batch:
            work.key = key(batch[-1])
            work.entries += len(batch)
            self._mark(work.key, work.entries, work.state)
        if len(batch) < SLICE:
            assert horizon is not None, "what is late belongs before what was let go"
            self._timeline.rebase(work.state, horizon)
            self._base_entries, self._rework = work.entries, None
            for (sender, boot, sequence), (_, is_set) in self._pending.items():
                self.applied.add_number(source(sender, boot), sequence)
                self.sets += is_set
                self.statements += not is_set
            self._pending.clear()
        self._update_counters()
        return not self._pending

    def resume(self, history: History, marks: Sequence[Mark]) -> None:
        """Begin with what a ledger holds, from its newest mark that leaves the rollback window whole."""
        contents = history.contents()
        self.applied = Applied(contents.watermarks)
        self.expired = Applied(contents.expired)
        self.counters["expired_sets"] = sum(map(counted, contents.expired.values()))
        newest = contents.newest
        self._marks = [m for m in marks if newest is not None and m.key[0] <= newest - self._rollback_s]
        place = None
        while self._marks:
            mark = self._marks[-1]
            try:
                self._timeline.rebase(mark.load(), mark.key)
            except DataError:  # written by other code, or damaged: what it was made of is there
                self._marks.pop()
                continue
            place, self._base_entries = mark.key, mark.entries
            break
        while batch := history.between(place, None, SLICE):
            place = key(batch[-1])
            self._timeline.insert_all([(key(entry), entry) for entry in batch])
            self._look_back()
        self.sets, self.statements = contents.sets, contents.statements
        self._update_counters()

    def take_marks(self) -> tuple[list[Mark], list[Key]]:
        """Marks made since the last call, and the keys of all that are kept, both the oldest first."""
        fresh, self._unsaved = self._unsaved, []
        keys = [mark.key for mark in self._marks]
        return [mark for mark in fresh if mark.key in keys], keys

    def _put_back(self, entry: LedgerEntry) -> None:
        """See that an entry comes to a place that the timeline has let go of."""
        if self._history is None:
            self._count(entry)
            self._timeline.append(entry)
            return
        place = key(entry)
        self._pending[identity(entry)] = place, isinstance(entry, MeasurementSetMessage)
        self._marks = [mark for mark in self._marks if mark.key < place]
        if self._rework is not None and self._rework.key is not None and place < self._rework.key:
            self._rework = None

    def _begin_rework(self) -> _Rework:
        first = min(place for place, _ in self._pending.values())
        work = _Rework(None, 0, self.initial)
        while self._marks:
            mark = self._marks[-1]
            assert mark.key < first, "marks behind a late entry hold no longer"
            try:
                work = _Rework(mark.key, mark.entries, mark.load())
                break
            except DataError:
                self._marks.pop()
        self._rework = work
        return work

    def _look_back(self) -> None:
        """Mark the state before the window, now and then; not while entries are missing in it."""
        timeline = self._timeline
        if timeline.horizon is not None and not self._pending:
            self._mark(timeline.horizon, self._base_entries + timeline.gone, timeline.base)

    def _mark(self, place: Key, entries: int, state: State) -> None:
        last = self._marks[-1].entries if self._marks else 0
        if self._history is None or entries - last < MARK_EVERY:
            return
        mark = Mark(place, entries, lambda: state)
        self._marks.append(mark)
        self._unsaved.append(mark)
        if len(self._marks) > MARKS:
            del self._marks[_least_missed([mark.entries for mark in self._marks])]

    def _count(self, entry: LedgerEntry) -> None:
        self.applied.add(entry)
        if isinstance(entry, MeasurementSetMessage):
            self.sets += 1
        else:
            self.statements += 1

    def _update_counters(self) -> None:
        self.counters["applied_sets"] = self.sets
        self.counters["reapplied_sets"] = self._timeline.reapplied + self._redone
        if self.statements:
            self.counters["applied_soft_observations"] = self.statements


def kind(entry: LedgerEntry) -> str:
    """How counters name it."""
    return "sets" if isinstance(entry, MeasurementSetMessage) else "soft_observations"


def _least_missed(counts: Sequence[int]) -> int:
    """Which of growing counts can go: gaps then grow with the distance from the last one."""
    gaps = [
        (counts[i + 1] - counts[i - 1]) / (counts[-1] - counts[i - 1] + 1) for i in range(1, len(counts) - 1)
    ]
    return 1 + int(np.argmin(gaps))


def _apply(
    search: Search[Any],
    sensors: Mapping[str, SensorModel],
    seed: int,
    void: dict[Identity, str],
    state: State,
    message: LedgerEntry,
) -> State:
    """The estimate after one more entry. Same entry, same draws: that is what makes replays exact."""
    rng = generator(seed, "fusion", message.sender, message.boot, message.sequence)
    sender = message.sender
    if isinstance(message, SoftObservationMessage):
        void.pop(identity(message), None)
        try:
            return search.observe(state, observation(message, search.area.dimension), message.time, rng)
        except ValueError as error:  # such as of a target that was found before: true, and no news
            void[identity(message)] = str(error)[:300]
            return state
    return search.apply(state, sensors[sender], message.pose, message.measurements, message.time, rng, sender)
