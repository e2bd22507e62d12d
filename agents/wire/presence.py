"""Who is there, whatever boot it is: the end of an old boot may be told after the begin of the next one."""

from agents.wire.transport import PeerChange


class Presence:
    """Of processes of one role. Mutable: remembers which boots of each have a token."""

    def __init__(self, role: str) -> None:
        self._role = role
        self._boots: dict[str, set[str]] = {}

    def __repr__(self) -> str:
        return f"Presence({self._role}, {sorted(name for name, boots in self._boots.items() if boots)})"

    def __contains__(self, name: str) -> bool:
        return bool(self._boots.get(name))

    def names(self) -> set[str]:
        """All that are there."""
        return {name for name, boots in self._boots.items() if boots}

    def take(self, change: PeerChange) -> bool | None:
        """What a change says of its process: True it came, False it went; None: nothing, or another role."""
        peer = change.peer
        if peer.role != self._role:
            return None
        boots = self._boots.setdefault(peer.id, set())
        if change.alive:
            new = not boots
            boots.add(peer.boot)
            return True if new else None
        boots.discard(peer.boot)
        return None if boots else False
