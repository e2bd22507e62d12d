"""A team of real processes on this machine that is struck by faults, and a history of what it said.

Everybody is started by hand, as in the field: router, fusion, robots, viewer. Whoever holds the team also
listens to it, and writes down what it did to whom; the same checker then reads that history.
"""

import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Literal, Self

from agents.clock import TeamClock
from agents.invariants.history import Places, RunHistory, Said
from agents.ledger.ledger import Ledger
from agents.mission.mission import Mission, link_of
from agents.plugins import load
from agents.swarm.run_directory import RunDirectory
from agents.wire.mailbox import Mailbox
from agents.wire.messages import PoseMessage, StartMessage
from agents.wire.topics import BID, PLAN, POSE, POSTERIOR, SET, START
from agents.wire.transport import Peer, Transport

OBSERVER = "observer"
POLL_S = 0.02
TOPICS = (POSE, SET, PLAN, BID, POSTERIOR, START)


class FieldTeam:
    """Use as a context manager: no process of it is left afterwards."""

    def __init__(self, mission: Mission, directory: Path, endpoint: str) -> None:
        """`endpoint` is where the router will listen."""
        self.run = RunDirectory.create(mission, directory)
        self.mission = mission
        self.history = RunHistory(mission, mission.seed, "processes")
        self._endpoint = endpoint
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._boots: dict[str, str] = {}  # the newest known of each
        self._clock: TeamClock | None = None
        self._transport: Transport | None = None
        self._mailbox = Mailbox(mission.team, lambda text: None)
        self._alive: set[Peer] = set()
        self._stack = ExitStack()

    def __repr__(self) -> str:
        return f"FieldTeam({sorted(self._processes)}, {self.history!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()
        for process in self._processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.kill()
        for process in self._processes.values():
            process.wait(10.0)

    @property
    def names(self) -> list[str]:
        """Everybody who has something to say."""
        return ["fusion", *(robot.id for robot in self.mission.robots), OBSERVER]

    def start(self, name: str) -> None:
        """Start a process: "router", "watch", "fusion", or a robot by its id."""
        words = [str(self.run.mission)]
        out = ["--out", str(self.run.path), "--connect", self._endpoint]
        if name == "router":
            words = ["router", *words, "--listen", self._endpoint]
        elif name in ("fusion", "watch"):
            words = [name, *words, *out, *(["--view", "none", "--quiet"] if name == "watch" else [])]
        else:
            words = ["robot", *words, "--id", name, *out]
        with (self.run.path / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-m", "agents.cli", *words], stdout=log, stderr=subprocess.STDOUT
            )

    def listen(self, deadline_s: float = 60.0) -> None:
        """Begin to hear the team; the router may still be starting."""
        made = load("transports", self.mission.link.kind)
        until = time.monotonic() + deadline_s
        while True:
            transport: Transport = made(link_of(self.mission), self.mission.team, endpoints=(self._endpoint,))
            try:
                transport.open(Peer("watch", OBSERVER, secrets.token_hex(6)), lambda: None)
                break
            except Exception:
                transport.close()
                if time.monotonic() > until:
                    raise
        self._transport = self._stack.enter_context(transport)
        for topic in TOPICS:
            transport.subscribe(topic, urgent=False)

    def kill(self, name: str) -> None:
        """SIGKILL."""
        process = self._processes[name]
        process.kill()
        process.wait(10.0)
        if name == "router":
            self._cut("cut")
        elif name in self._boots:
            self.history.tell(self.now(), "down", name)

    def stop(self, name: str) -> None:
        """SIGSTOP."""
        self._processes[name].send_signal(signal.SIGSTOP)
        self.history.tell(self.now(), "stopped", name)

    def go_on(self, name: str) -> None:
        """SIGCONT."""
        self.history.tell(self.now(), "going", name)
        self._processes[name].send_signal(signal.SIGCONT)

    def router_is_back(self) -> None:
        """To be called once everybody has met again."""
        self._cut("healed")

    def now(self) -> float:
        """Team time; 0 before the start."""
        return 0.0 if self._clock is None else self._clock.now()

    def present(self, names: Sequence[str]) -> bool:
        """Whether all of these are seen alive now."""
        return set(names) <= {peer.id for peer in self._alive}

    def until(self, condition: Callable[[], bool], deadline_s: float) -> bool:
        """Listen until something holds; whether it came to that in time."""
        end = time.monotonic() + deadline_s
        while time.monotonic() < end:
            self._hear()
            if condition():
                return True
            time.sleep(POLL_S)
        return False

    def for_(self, seconds: float) -> None:
        """Listen for some seconds."""
        self.until(lambda: False, seconds)

    def finish(self) -> RunHistory:
        """End everybody politely; the history, with what the ledger holds."""
        for name, process in self._processes.items():
            if process.poll() is None and name != "router":
                process.send_signal(signal.SIGCONT)
                process.terminate()
        self.until(
            lambda: all(p.poll() is not None for n, p in self._processes.items() if n != "router"), 15.0
        )
        self.history.tell(self.now(), "end")
        with Ledger(self.run.ledger) as ledger:
            self.history.ledgers["fusion"] = list(ledger.replay(self.mission.team))
        return self.history

    def _cut(self, what: Literal["cut", "healed"]) -> None:
        for one in self.names:
            for other in self.names:
                if one != other:
                    self.history.tell(self.now(), what, one, other=other)

    def _hear(self) -> None:
        assert self._transport is not None, "listen() comes first"
        for change in self._transport.drain_peer_changes():
            peer = change.peer
            (self._alive.add if change.alive else self._alive.discard)(peer)
            if change.alive and self._boots.get(peer.id) != peer.boot and peer.role in ("robot", "fusion"):
                self._boots[peer.id] = peer.boot
                self.history.tell(self.now(), "up", peer.id, role=peer.role, boot=peer.boot)
        places: dict[str, tuple[float, float, float]] = {}
        for heard in self._mailbox.open(self._transport.drain()):
            message = heard.message
            if isinstance(message, StartMessage):
                if self._clock is None:
                    self._clock = TeamClock(message.epoch, message.speed)
                continue
            self.history.said.append(Said(self.now(), heard.topic.name, message))
            if isinstance(message, PoseMessage):
                x, y, z = message.pose[:3].tolist()
                places[message.sender] = (x, y, z)
        if len(places) == len(self.mission.robots):
            self.history.places.append(Places(self.now(), places))
