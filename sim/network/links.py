"""The ways between hosts: open, cut for a while, given up, or just uncut."""

from collections import deque
from collections.abc import Callable, Collection, Iterator
from enum import Enum
from typing import Any

import numpy as np

from sim.network.conditions import Weather

BACK_S = (0.1, 1.2)  # until both ends of a cut link have met again, as measured of Zenoh
HELD = 1024  # messages that wait in a cut link's buffers; beyond them the newest is dropped

Post = Callable[[float, Callable[[], None]], None]  # (delay, action): do it that much later


class LinkState(Enum):
    """What becomes of a message."""

    OPEN = "open"
    CUT = "cut"  # it waits in the buffers of TCP, and comes in a burst if the cut is short
    LOST = "lost"  # the lease is over: the sink has given the source up, it is lost
    BACK = "back"  # uncut, but the ends have not met again yet: lost


class Link:
    """From one name to another, whoever bears them."""

    __slots__ = ("cuts", "epoch", "fifo_at", "held", "sink", "source", "state", "weather")

    def __init__(self, source: str, sink: str) -> None:
        self.source, self.sink = source, sink
        self.state = LinkState.OPEN
        self.cuts = 0  # what was cut twice must heal twice
        self.epoch = 0  # grows with every change: what was planned for an older one is void
        self.fifo_at = 0.0  # nothing overtakes what arrives then
        self.held: deque[tuple[Any, ...]] = deque(maxlen=HELD)
        self.weather = Weather()

    def __repr__(self) -> str:
        return f"Link({self.source} -> {self.sink}, {self.state.value}, cuts={self.cuts})"

    def hold(self, *message: Any) -> None:
        """Keep a message for when the cut is over; a full buffer takes no more."""
        if len(self.held) < HELD:
            self.held.append(message)


class Links:
    """All links of one network. `changed` is told of each that became open or was given up."""

    def __init__(self, rng: np.random.Generator, post: Post, changed: Callable[[Link], None]) -> None:
        self.closed = 0  # how many are not open
        self._rng = rng
        self._post = post
        self._changed = changed
        self._links: dict[tuple[str, str], Link] = {}
        self._silent: set[str] = set()  # stopped beyond the lease

    def __repr__(self) -> str:
        return f"Links(closed={self.closed}, silent={sorted(self._silent)})"

    def __getitem__(self, ends: tuple[str, str]) -> Link:
        link = self._links.get(ends)
        if link is None:
            link = self._links[ends] = Link(*ends)
            if self._blocked(link):
                self._enter(link, LinkState.LOST)
        return link

    def open(self, source: str, sink: str) -> bool:
        """Whether a message gets from one to the other."""
        return not self.closed or self[source, sink].state is LinkState.OPEN

    def cut(self, sources: Collection[str], sinks: Collection[str], lease_s: float) -> None:
        """Nothing gets from a source to a sink until it is healed as often as it was cut."""
        for link in self._between(sources, sinks):
            link.cuts += 1
            if link.state is LinkState.OPEN:
                epoch = self._enter(link, LinkState.CUT)
                self._post(lease_s, lambda k=link, e=epoch: self._give_up(k, e))  # type: ignore[misc]
            elif link.state is LinkState.BACK:
                self._enter(link, LinkState.LOST)

    def heal(self, sources: Collection[str], sinks: Collection[str]) -> Iterator[Link]:
        """Undo a cut. Links that were cut for less than the lease are given out, with what they hold."""
        for link in self._between(sources, sinks):
            link.cuts -= 1
            if self._blocked(link):
                continue
            if link.state is LinkState.CUT:
                self._enter(link, LinkState.OPEN)
                yield link
                link.held.clear()
                self._changed(link)
            else:
                self._meet_again(link)

    def silence(self, name: str, others: Collection[str]) -> None:
        """A process has been silent beyond the lease: it is given up by the others, and its links with it."""
        links = self._between([name], others) + self._between(others, [name])
        self._silent.add(name)
        for link in links:
            if link.state is not LinkState.LOST:
                self._enter(link, LinkState.LOST)
                link.held.clear()
                self._changed(link)

    def answer(self, name: str) -> None:
        """It answers again."""
        if name in self._silent:
            self._silent.remove(name)
            for link in self._of(name):
                if not self._blocked(link):
                    self._meet_again(link)

    def _blocked(self, link: Link) -> bool:
        return bool(link.cuts) or link.source in self._silent or link.sink in self._silent

    def _meet_again(self, link: Link) -> None:
        if link.state is not LinkState.LOST:
            return
        epoch = self._enter(link, LinkState.BACK)

        def back() -> None:
            if link.epoch != epoch:
                return
            # Both directions are of one session: they come back together.
            opened = [k for k in (link, self[link.sink, link.source]) if k.state is LinkState.BACK]
            for one in opened:
                self._enter(one, LinkState.OPEN)
            for one in opened:
                self._changed(one)

        self._post(float(self._rng.uniform(*BACK_S)), back)

    def _give_up(self, link: Link, epoch: int) -> None:
        if link.epoch == epoch:
            self._enter(link, LinkState.LOST)
            link.held.clear()
            self._changed(link)

    def _enter(self, link: Link, state: LinkState) -> int:
        self.closed += (state is not LinkState.OPEN) - (link.state is not LinkState.OPEN)
        link.state = state
        link.epoch += 1
        return link.epoch

    def _between(self, sources: Collection[str], sinks: Collection[str]) -> list[Link]:
        return [self[a, b] for a in sorted(sources) for b in sorted(sinks) if a != b]

    def _of(self, name: str) -> list[Link]:
        return [link for ends, link in sorted(self._links.items()) if name in ends]
