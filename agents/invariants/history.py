"""A run's history: what was said when, and what truly happened meanwhile.

Times are true team time, whatever a process's clock showed. In memory the engine appends to it; in a run
directory it is the file history.msgpack, whose last record may be torn if its writer was killed.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Literal

import msgpack
import msgspec

from agents.errors import DataError, MalformedMessage, StorageError
from agents.ledger.ledger import Ledger
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.swarm.run_directory import RunDirectory
from agents.wire import codec
from agents.wire.messages import LedgerEntry, Message
from agents.wire.topics import TOPICS

FILE = "history.msgpack"
_LENGTH = struct.Struct("<I")

What = Literal[
    "up",  # a process started: `who`, `role`, `boot`
    "down",  # it ended or was killed
    "stopped",  # SIGSTOP, or otherwise unable to look
    "going",  # SIGCONT
    "slow",  # it looks at what has come only every `value` s
    "quick",  # no more
    "cut",  # nothing gets from `who` to `other`
    "healed",
    "full",  # the disk of `who` takes nothing
    "free",
    "lossy",  # what is not offered again may be lost from now on, on all links; `value` is the share
    "calm",  # that is over
    "delay",  # messages may take `value` seconds longer
    "clock",  # the time of day of `who` is off by `value` s
    "end",  # of the run
]


class Fact(msgspec.Struct, frozen=True, kw_only=True):
    """Something that truly happened, known to whoever made it happen."""

    at: float
    what: What
    who: str = ""
    other: str = ""
    role: str = ""
    boot: str = ""
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Said:
    """A message as it left its sender."""

    at: float
    topic: str
    message: Message


class Places(msgspec.Struct, frozen=True):
    """Where the robots truly were, m."""

    at: float
    robots: dict[str, tuple[float, float, float]]


class Used(msgspec.Struct, frozen=True):
    """What a process heard of `sender` on a topic `age` seconds ago, and decided by."""

    at: float
    who: str
    topic: str
    sender: str
    age: float


class Size(msgspec.Struct, frozen=True):
    """How much a process keeps of something; `bound` 0: there is no fixed one."""

    at: float
    who: str
    boot: str
    what: str
    value: float
    bound: float = 0.0


_KINDS: dict[str, Any] = {"fact": Fact, "places": Places, "used": Used, "size": Size}


@dataclass
class RunHistory:
    """All of a run. Lists are in the order of time."""

    mission: Mission
    seed: int
    driver: str  # "virtual" or "processes"
    said: list[Said] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    places: list[Places] = field(default_factory=list)
    used: list[Used] = field(default_factory=list)
    sizes: list[Size] = field(default_factory=list)
    ledgers: dict[str, Sequence[LedgerEntry]] = field(default_factory=dict)  # by fusion, as they arrived

    def __repr__(self) -> str:
        return f"RunHistory({self.mission.name}, seed={self.seed}, said={len(self.said)}, end={self.end:.1f})"

    @property
    def end(self) -> float:
        """When the run ended."""
        ends = [fact.at for fact in self.facts if fact.what == "end"]
        return ends[-1] if ends else self.said[-1].at if self.said else 0.0

    def tell(self, at: float, what: What, who: str = "", **more: Any) -> None:
        """Note a fact."""
        self.facts.append(Fact(at=at, what=what, who=who, **more))

    def by(self, kind: type[Message]) -> Iterable[tuple[float, Any]]:
        """When each message of a kind was said, and the message."""
        return ((said.at, said.message) for said in self.said if isinstance(said.message, kind))

    def write(self, directory: Path) -> None:
        """Keep it as FILE in a run directory.

        Raises:
            StorageError: if the disk does not take it.
        """
        try:
            with (directory / FILE).open("wb") as file:
                writer = HistoryWriter(file, self.seed, self.driver)
                for said in self.said:
                    writer.said(said)
                for kind, items in self._others():
                    for item in items:
                        writer.other(kind, item)
        except OSError as error:
            raise StorageError(f"cannot write {directory / FILE}: {error.strerror}") from error

    def _others(self) -> list[tuple[str, Sequence[Any]]]:
        return [
            ("fact", self.facts),
            ("places", self.places),
            ("used", self.used),
            ("size", self.sizes),
        ]

    @classmethod
    def read(cls, directory: Path) -> "RunHistory":
        """What a run directory holds: its mission and ledgers, and its history if there is one.

        Raises:
            DataError: if it is no run's directory, or its history is none.
            MissionError: if its mission is not one any more.
        """
        run = RunDirectory(directory)
        if not run.mission.is_file():
            raise DataError(f"{directory} holds no mission.toml; give the directory of a run")
        mission = load(run.mission)
        history = cls(mission, mission.seed, "processes")
        file = directory / FILE
        if file.is_file():
            history._fill(file)
        for path in sorted(directory.glob("*.sqlite")):
            with Ledger(path) as ledger:
                name = "fusion" if path == run.ledger else path.stem.removeprefix("ledger-")
                history.ledgers[name] = list(ledger.replay(mission.team))
        return history

    def _fill(self, file: Path) -> None:
        lists: Mapping[str, list[Any]] = dict(self._others())  # type: ignore[arg-type]
        for record in _records(file):
            kind = record[0]
            try:
                if kind == "head":
                    self.seed, self.driver = record[1], record[2]
                elif kind == "said":
                    _, at, topic, sender, payload = record
                    message = codec.decode(TOPICS[topic], payload, team=self.mission.team, sender=sender)
                    self.said.append(Said(at, topic, message))
                else:
                    lists[kind].append(msgspec.convert(record[1], _KINDS[kind], strict=False))
            except (KeyError, ValueError, TypeError, MalformedMessage, msgspec.ValidationError) as error:
                raise DataError(f"{file} is no run's history: {error}") from None
        for some in (self.said, *lists.values()):
            some.sort(key=lambda item: item.at)


class HistoryWriter:
    """Appends records to an open file, so that a killed writer loses the last one at most."""

    def __init__(self, file: BinaryIO, seed: int, driver: str) -> None:
        self._file = file
        self._write(("head", seed, driver))

    def said(self, said: Said) -> None:
        """A message."""
        payload = codec.encode(said.message)
        self._write(("said", said.at, said.topic, said.message.sender, payload))

    def other(self, kind: str, item: Any) -> None:
        """A fact, places, a use or a size."""
        self._write((kind, msgspec.to_builtins(item)))

    def _write(self, record: tuple[Any, ...]) -> None:
        payload = msgpack.packb(record)
        self._file.write(_LENGTH.pack(len(payload)) + payload)


def _records(file: Path) -> Iterable[list[Any]]:
    data = file.read_bytes()
    at = 0
    while at + _LENGTH.size <= len(data):
        (length,) = _LENGTH.unpack_from(data, at)
        at += _LENGTH.size
        if at + length > len(data):
            return  # torn
        try:
            record = msgpack.unpackb(data[at : at + length], raw=False)
        except Exception as error:  # whatever the parser says of garbage
            raise DataError(f"{file} is no run's history: {error}") from None
        if not isinstance(record, list) or not record:
            raise DataError(f"{file} is no run's history: a record is no list")
        yield record
        at += length
