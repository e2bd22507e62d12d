"""Apply entries in the order of their keys although they arrive in any order.

The states after the recent entries are kept (they are frozen, so this costs no copies). An entry that
belongs earlier is put in its place and everything after it is applied again, so that any arrival order
within the window gives bit for bit the state of the right order.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Generic, TypeVar

from agents.ledger.history import Key

S = TypeVar("S")
E = TypeVar("E")


class Arrival(Enum):
    """Where an entry came in the order."""

    IN_ORDER = "in order"
    ROLLED_BACK = "rolled back"  # put in its place within the window
    TOO_LATE = "too late"  # older than the window: the caller decides


class Timeline(Generic[S, E]):
    """A state that is a function of its entries in key order, over a rollback window in seconds."""

    def __init__(self, initial: S, apply: Callable[[S, E], S], window: float) -> None:
        self._apply = apply
        self._window = window
        self._base = initial  # the state before the first kept entry
        self._keys: list[Key] = []
        self._entries: list[E] = []
        self._states: list[S] = []  # after each kept entry
        self._horizon: Key | None = None  # the newest key that was let go
        self.gone = 0  # entries let go into the base since it was given
        self.reapplied = 0

    def __repr__(self) -> str:
        return f"Timeline(kept={len(self._keys)}, reapplied={self.reapplied})"

    @property
    def state(self) -> S:
        """After all entries."""
        return self._states[-1] if self._states else self._base

    @property
    def base(self) -> S:
        """After the entries that were let go."""
        return self._base

    @property
    def horizon(self) -> Key | None:
        """The newest key that was let go; what belongs before it cannot be put in its place."""
        return self._horizon

    @property
    def newest(self) -> Key | None:
        """The last key of all."""
        return self._keys[-1] if self._keys else self._horizon

    def rebase(self, state: S, horizon: Key) -> None:
        """Let another state stand for all up to a key, and apply what is kept beyond it again."""
        gone = bisect_right(self._keys, horizon)
        del self._keys[:gone], self._entries[:gone]
        self._base, self._horizon, self._states, self.gone = state, horizon, [], 0
        for entry in self._entries:
            self._states.append(self._apply(self.state, entry))
        self.reapplied += len(self._entries)

    def insert(self, key: Key, entry: E) -> Arrival:
        """Put an entry in its place; an entry older than the window is not applied."""
        if self.too_late(key):
            return Arrival.TOO_LATE
        return self.insert_all([(key, entry)])[0]

    def too_late(self, key: Key) -> bool:
        """Whether a key lies before what can still be applied again."""
        newest = self.newest
        return self.let_go(key) or (newest is not None and key[0] < newest[0] - self._window)

    def let_go(self, key: Key) -> bool:
        """Whether a key lies before what is kept: nothing can be put there without going further back."""
        return self._horizon is not None and key < self._horizon

    def insert_all(self, items: Sequence[tuple[Key, E]]) -> list[Arrival]:
        """Put entries in their places, by growing key and none `too_late`, as `insert` would one by one.

        What lies behind them is applied again once and not once for each.
        """
        if not items:
            return []
        newest = self._keys[-1] if self._keys else None
        first = bisect_right(self._keys, items[0][0])
        redone = len(self._keys) - first
        for key, entry in items:
            place = bisect_right(self._keys, key)
            self._keys.insert(place, key)
            self._entries.insert(place, entry)
        del self._states[first:]
        state = self.state
        for later in self._entries[first:]:
            state = self._apply(state, later)
            self._states.append(state)
        self.reapplied += redone
        self._let_go()
        return [
            Arrival.ROLLED_BACK if newest is not None and key < newest else Arrival.IN_ORDER
            for key, _ in items
        ]

    def append(self, entry: E) -> None:
        """Apply an entry after everything else, wherever its time would put it."""
        if not self._keys:
            self._base = self._apply(self._base, entry)
            return
        # It shares the place of the newest entry, so that a rollback before that one takes both again.
        key = self._keys[-1]
        self._entries.append(entry)
        self._states.append(self._apply(self.state, entry))
        self._keys.append(key)

    def _let_go(self) -> None:
        oldest = self._keys[-1][0] - self._window
        count = 0
        while count < len(self._keys) - 1 and self._keys[count][0] < oldest:
            count += 1
        if count:
            self._base = self._states[count - 1]
            self._horizon = self._keys[count - 1]
            self.gone += count
            del self._keys[:count], self._entries[:count], self._states[:count]
