"""From bytes to messages: decode, refuse, count, and notice what is missing or comes twice."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Protocol

from agents.errors import MalformedMessage
from agents.machine import Heard
from agents.wire import codec
from agents.wire.messages import Message
from agents.wire.topics import Drop, Topic
from agents.wire.transport import Received


class Decode(Protocol):
    """The signature of `codec.decode`."""

    def __call__(self, topic: Topic, payload: bytes, *, team: str, sender: str) -> Message: ...


class Mailbox:
    """One process's view of what it is sent. Counters are for health; notices are for people, once each."""

    def __init__(self, team: str, notice: Callable[[str], None], decode: Decode = codec.decode) -> None:
        self.team = team
        self.counters: Counter[str] = Counter()
        self.wanted: Callable[[Topic, str], bool] | None = None  # else it is not even decoded
        self.on_refusal: Callable[[str, str], None] = lambda topic, sender: None
        self._notice = notice
        self._decode = decode
        self._noticed: set[tuple[str, str]] = set()
        self._newest: dict[tuple[str, str, str], int] = {}
        self._missing: dict[tuple[str, str, str], set[int]] = {}

    def __repr__(self) -> str:
        return f"Mailbox({dict(self.counters)})"

    def open(self, received: Iterable[Received]) -> list[Heard]:
        """The good messages among what was received; the rest is counted by reason."""
        heard = []
        for item in received:
            self.counters["received"] += 1
            if self.wanted is not None and not self.wanted(item.topic, item.sender):
                self.counters["passed_over"] += 1
                continue
            try:
                message = self._decode(item.topic, item.payload, team=self.team, sender=item.sender)
            except MalformedMessage as error:
                self._reject(item, error)
                continue
            if item.topic.drop is not Drop.LATEST_ONLY:
                self._follow_sequence(item.topic, message)
            heard.append(Heard(item.topic, message))
        return heard

    @property
    def lost(self) -> int:
        """Messages of queued topics that others numbered and that never came."""
        return sum(len(missing) for missing in self._missing.values())

    def _reject(self, item: Received, error: MalformedMessage) -> None:
        self.on_refusal(item.topic.name, item.sender)
        self.counters["rejected"] += 1
        self.counters[f"rejected.{error.reason}"] += 1
        if (item.sender, error.reason) not in self._noticed:
            self._noticed.add((item.sender, error.reason))
            self._notice(f"refused a {item.topic.name} message of {item.sender}: {error}")

    def _follow_sequence(self, topic: Topic, message: Message) -> None:
        stream = (topic.name, message.sender, message.boot)
        newest = self._newest.get(stream)
        missing = self._missing.setdefault(stream, set())
        if newest is None or message.sequence > newest:
            # What a stream said before it was first heard is not missed: history and re-offers bring it.
            if newest is not None:
                missing.update(range(newest + 1, min(message.sequence, newest + 10_000)))
            self._newest[stream] = message.sequence
        elif message.sequence in missing:
            missing.remove(message.sequence)
            self.counters["recovered"] += 1
        else:
            self.counters["duplicate"] += 1
