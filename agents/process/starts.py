"""How a team is started, once: the first fusion sets its clock, the others and all robots take it over.

Two fusions that could not hear each other may both have started the team. Then there are two times, and a
set of one makes no sense in the other: they are never merged. The earlier start counts; whoever follows the
later one is told so and what to do, its fusion ends, and its robots take no more sets.
"""

import asyncio
import time
from collections.abc import Sequence

from agents.clock import TeamClock
from agents.errors import JoinError, MissionError
from agents.ledger.ledger import Ledger
from agents.machine import Event, Heard
from agents.mission.mission_file import mission_hash
from agents.process.shell import Shell
from agents.wire.messages import StartMessage
from agents.wire.presence import Presence
from agents.wire.transport import PeerChange

START_DELAY_S = 0.5  # from the start message to team time 0, so that all hear of it before


class TeamStart:
    """One fusion's part: go on with its ledger's start, join another's, or start the team."""

    def __init__(self, shell: Shell, ledger: Ledger, speed: float) -> None:
        self.speed = speed
        self.early: list[Event] = []  # what came before, for the fusion
        self._shell = shell
        self._ledger = ledger
        self._robots = Presence("robot")
        self._others: StartMessage | None = None  # of a fusion that started the team before

    def __repr__(self) -> str:
        return f"TeamStart({self._shell.name}, speed={self.speed:g}, others={self._others is not None})"

    def goes_on(self) -> bool:
        """Take over the clock of an earlier life, if the ledger holds one."""
        epoch = self._ledger.fact("epoch")
        if epoch is None:
            return False
        self.speed = float(self._ledger.fact("speed") or 1.0)
        self._shell.clock = TeamClock(float(epoch), self.speed)
        return True

    async def wait(self) -> bool:
        """Wait for the robots and start the clock, or for another's start; False if told to end meanwhile."""
        shell = self._shell
        wanted = {robot.id for robot in shell.mission.robots}
        first = shell.name == shell.mission.fusions()[0]
        deadline = time.monotonic() + shell.mission.settings.start_timeout_s * (1.0 if first else 1.5)
        while not shell.stopping and self._others is None and time.monotonic() < deadline:
            self._note(shell.events())
            if first and wanted <= self._robots.names():
                break
            await asyncio.sleep(0.02)
        if shell.stopping:
            return False
        if self._others is not None:
            self._join(self._others)
            return True
        missing = sorted(wanted - self._robots.names())
        if missing:
            shell.announce(f"starts without {', '.join(missing)}: they may join later", "warning")
        start = time.time() + START_DELAY_S
        self._remember(start)
        shell.clock = TeamClock(start, self.speed)
        return True

    def compare(self, start: StartMessage) -> None:
        """Look at the start that another fusion tells of.

        Raises:
            JoinError: if the team was started by that one before.
        """
        before = self._shell.clock.later_than(start.epoch)
        if start.sender != self._shell.name and before > 0.0:
            raise JoinError(
                f"{start.sender} had started this team {before:.1f} s before {self._shell.name} did, and two "
                "starts are two times: this fusion ends. Its sets stay in its ledger (`searchparty ledger`). "
                "Start it again in an empty run directory, and it joins; robots that it had started, too"
            )

    def _join(self, start: StartMessage) -> None:
        """Another fusion has started the team."""
        shell, mission = self._shell, self._shell.mission
        if start.mission_hash != mission_hash(mission) or start.seed != mission.seed:
            raise MissionError(
                f"{shell.name} has another mission file or seed than {start.sender}: "
                "give every fusion of the team the same"
            )
        self.speed = start.speed
        self._remember(start.epoch)
        shell.adopt(start)
        shell.announce(f"joins the team that {start.sender} has started")

    def _remember(self, epoch: float) -> None:
        mission = self._shell.mission
        facts = {
            "epoch": repr(epoch),
            "speed": repr(self.speed),
            "seed": str(mission.seed),
            "mission": mission.name,
            "mission_hash": mission_hash(mission),
            "rollback_s": repr(mission.fusion.rollback_s),
            "fusion": self._shell.name,
        }
        for name in reversed(facts):  # the epoch last: with it the ledger is one to go on with
            self._ledger.remember(name, facts[name])

    def _note(self, events: Sequence[Event]) -> None:
        for event in events:
            if isinstance(event, Heard) and isinstance(event.message, StartMessage):
                self._others = event.message
            if isinstance(event, PeerChange):
                self._robots.take(event)
            elif isinstance(event, Heard):
                self.early.append(event)
