"""Robots of a running swarm killed by SIGKILL, and how long until others hold their tasks."""

import signal
import time
from pathlib import Path
from typing import Any

import psutil

from agents.mission.mission_file import load
from agents.wire.mailbox import Mailbox
from agents.wire.messages import BidMessage
from agents.wire.topics import BID
from agents.wire.transport import Peer
from benchmarks import swarms
from bridges.zenoh.transport import ZenohTransport

SETTLE_S = 6.0  # after the last robot was heard for the first time
PATIENCE_S = 30.0
START_S = 120.0  # kernels may have to be compiled first


def mission(robots: int) -> dict[str, Any]:
    """Robots that share tasks, to the end of the time."""
    table = swarms.mission(robots, 300.0)
    # Room in the bundles for all tasks, also when two robots of six are left: else some wait for an owner.
    table["planner"] = {"kind": "cbba", "bundle": 30}
    return table


class Listener:
    """Hears all bids of a team, and sees tokens go."""

    def __init__(self, transport: ZenohTransport, team: str) -> None:
        self._transport = transport
        self._mailbox = Mailbox(team, lambda text: None)
        self.words: dict[str, BidMessage] = {}
        self.gone: dict[str, float] = {}  # robot -> wall time

    def listen(self, seconds: float) -> None:
        """Take in what comes."""
        until = time.perf_counter() + seconds
        while time.perf_counter() < until:
            for change in self._transport.drain_peer_changes():
                if not change.alive:
                    self.gone[change.peer.id] = time.perf_counter()
            for heard in self._mailbox.open(self._transport.drain()):
                if isinstance(heard.message, BidMessage):
                    self.words[heard.message.sender] = heard.message
            time.sleep(0.001)

    def held(self, robot: str) -> set[str]:
        """Tasks that a robot last said to hold, and that others know of too."""
        known = {t for name, w in self.words.items() if name != robot for t in w.tasks}
        return set(self.words[robot].path) & known

    def orphans(self, tasks: set[str]) -> set[str]:
        """Of tasks, those that nobody alive holds and somebody alive still sees to be done."""
        alive = [word for robot, word in self.words.items() if robot not in self.gone]
        known = {task for word in alive for task in word.tasks}
        return (tasks & known) - {task for word in alive for task in word.path}


def takeovers(robots: int, kills: int, directory: Path) -> tuple[list[float], list[float]]:
    """Seconds from each kill to the token's end, and from there until others hold all of the robot's tasks.

    Raises:
        RuntimeError: if the team does not come to share tasks, or nobody takes over.
    """
    out = directory / "run"
    with swarms.started(mission(robots), directory, out) as launcher:
        processes, endpoint = _robots(launcher.pid, robots)
        loaded = load(out / "mission.toml")
        transport = ZenohTransport(loaded.link, loaded.team, endpoints=(endpoint,))
        with transport:
            transport.open(Peer("watch", "benchmark", "b0"), lambda: None)
            transport.subscribe(BID)
            listener = Listener(transport, loaded.team)
            began = time.perf_counter()
            while len(listener.words) < robots:
                listener.listen(0.1)
                if time.perf_counter() - began > PATIENCE_S:
                    raise RuntimeError(f"only {sorted(listener.words)} bid; see {out}")
            seen, taken = [], []
            for robot in sorted(processes)[:kills]:
                listener.listen(SETTLE_S)
                tasks = listener.held(robot)
                killed = time.perf_counter()
                processes[robot].send_signal(signal.SIGKILL)
                while robot not in listener.gone:
                    listener.listen(0.002)
                    if time.perf_counter() - killed > PATIENCE_S:
                        raise RuntimeError(f"{robot}'s token stands {PATIENCE_S} s after its death")
                while listener.orphans(tasks):
                    listener.listen(0.002)
                    if time.perf_counter() - killed > PATIENCE_S:
                        raise RuntimeError(f"nobody took over {listener.orphans(tasks)} of {robot}")
                seen.append(listener.gone[robot] - killed)
                taken.append(time.perf_counter() - listener.gone[robot])
            return seen, taken


def _robots(launcher: int, count: int) -> tuple[dict[str, psutil.Process], str]:
    """The robots' processes by id, and where their router is."""
    until = time.perf_counter() + START_S
    found: dict[str, psutil.Process] = {}
    endpoint = ""
    while time.perf_counter() < until and len(found) < count:
        for process in psutil.Process(launcher).children(recursive=True):
            try:
                words = process.cmdline()
            except psutil.Error:
                continue
            # A forked child has its command line as one title.
            words = " ".join(words).split()
            if "robot" in words and "--id" in words and "--connect" in words:
                found[words[words.index("--id") + 1]] = process
                endpoint = words[words.index("--connect") + 1]
        time.sleep(0.1)
    if len(found) < count:
        raise RuntimeError(f"only {sorted(found)} of {count} robots were started")
    return found, endpoint
