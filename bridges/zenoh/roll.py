"""Who is alive, from Zenoh's liveliness tokens."""

import threading
import time
from collections.abc import Callable

import zenoh

from agents.wire.transport import Peer, PeerChange

CONFIRM_S = 2.0


class Roll:
    """The tokens of a team, listed once at the start and then followed.

    Zenoh answers a listing at once and completely only before one follows the tokens; afterwards it leaves
    out what is on its way already. So `listed` comes first, and who is not seen again within `CONFIRM_S`
    was gone before `followed` could tell.
    """

    def __init__(self, me: Peer, wake: Callable[[], None]) -> None:
        self.closed = False
        self._me = me
        self._wake = wake
        self._lock = threading.Lock()
        self._alive: set[Peer] = set()
        self._unconfirmed: set[Peer] = set()
        self._listed_at = time.monotonic()
        self._changes: list[PeerChange] = []

    def __repr__(self) -> str:
        return f"Roll(alive={sorted(peer.id for peer in self._alive)})"

    def listed(self, sample: zenoh.Sample) -> None:
        """A token stood when asked."""
        peer = _peer(sample)
        with self._lock:
            self._change(peer, True)
            self._unconfirmed.add(peer)

    def followed(self, sample: zenoh.Sample) -> None:
        """A token came, goes on standing, or went."""
        if self.closed:
            return
        peer = _peer(sample)
        with self._lock:
            self._unconfirmed.discard(peer)
            changed = self._change(peer, sample.kind == zenoh.SampleKind.PUT)
        if changed:
            self._wake()

    def drain(self) -> list[PeerChange]:
        """What changed since the last call."""
        with self._lock:
            if self._unconfirmed and time.monotonic() > self._listed_at + CONFIRM_S:
                for peer in self._unconfirmed:
                    self._change(peer, False)
                self._unconfirmed.clear()
            changes, self._changes = self._changes, []
        return changes

    def _change(self, peer: Peer, alive: bool) -> bool:
        if peer == self._me or alive == (peer in self._alive):
            return False
        (self._alive.add if alive else self._alive.remove)(peer)
        self._changes.append(PeerChange(peer, alive))
        return True


def _peer(sample: zenoh.Sample) -> Peer:
    role, peer_id, boot = str(sample.key_expr).split("/")[-3:]
    return Peer(role, peer_id, boot)
