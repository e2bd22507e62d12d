"""Two computers whose clocks differ, in one process: what a joining process makes of it."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from agents.clock import TeamClock
from agents.errors import JoinError
from agents.machine import ClockTrust, Heard
from agents.mission.mission import Mission
from agents.mission.mission_file import mission_hash
from agents.process.clock_sync import ClockAnswers
from agents.process.shell import Shell
from agents.wire.messages import ClockMessage, Message, StartMessage
from agents.wire.topics import CLOCK, START
from bridges.zenoh.local_router import Router
from tests.agents.fakes import mission


class Elsewhere:
    """A fusion on a computer whose time of day is `ahead` seconds ahead; it tells the team's time."""

    def __init__(self, shell: Shell, ahead: float) -> None:
        self.shell = shell
        self.ahead = ahead
        shell.clock = TeamClock(time.time() - 5.0)
        self.heard: list[Message] = []
        self._answers = ClockAnswers()

    async def run(self) -> None:
        self.shell.transport.subscribe(CLOCK)
        while not self.shell.stopping:
            for event in self.shell.events():
                if isinstance(event, Heard):
                    self.heard.append(event.message)
                if isinstance(event, Heard) and isinstance(event.message, ClockMessage):
                    self._answers.hear(event.message, self.shell.clock.now())
            self.tell()
            await asyncio.sleep(0.05)

    def tell(self) -> None:
        shell = self.shell
        message = StartMessage(
            **shell.stamp.header(START, shell.clock.now()),
            epoch=shell.clock.epoch + self.ahead,  # as its own time of day says
            speed=1.0,
            seed=7,
            mission_hash=mission_hash(shell.mission),
            answers=self._answers.take(),
        )
        shell.publish(START, message)


@asynccontextmanager
async def two_computers(team: Mission, ahead: float) -> AsyncIterator[tuple[Elsewhere, Shell]]:
    """That fusion, and a robot's shell here that has not joined yet."""
    with Router(team.link) as router:
        async with (
            Shell(team, "fusion", "fusion", router.endpoints) as there,
            Shell(team, "robot", "r1", router.endpoints) as here,
        ):
            fusion = Elsewhere(there, ahead)
            running = asyncio.create_task(fusion.run())
            try:
                yield fusion, here
            finally:
                there.stop()
                await running


@pytest.mark.parametrize("ahead", [-3.0, 3.0])
def test_a_process_begins_in_team_time_wherever_its_computers_clock_is(ahead: float) -> None:
    async def join() -> tuple[float, float]:
        async with two_computers(mission(1), ahead) as (fusion, here):
            assert await here.join_team() == 7
            assert here.sync is not None
            return here.clock.now() - fusion.shell.clock.now(), here.sync.correction

    off, correction = asyncio.run(join())
    assert abs(off) < 0.5, "corrected within the round trip"
    assert correction == pytest.approx(ahead, abs=0.5)


def test_a_clock_that_is_right_is_not_touched() -> None:
    async def join() -> float:
        async with two_computers(mission(1), 0.0) as (_, here):
            await here.join_team()
            assert here.sync is not None
            assert "clock_offset_ms" in here.gauges()
            return here.sync.correction

    assert asyncio.run(join()) == 0.0


def test_a_computer_whose_clock_is_far_off_is_refused_with_a_sentence() -> None:
    async def join() -> None:
        async with two_computers(mission(1), 3600.0) as (_, here):
            await here.join_team()

    with pytest.raises(JoinError, match=r"the clock of r1 is 36\d\d\.\d+ s behind the team's.*set it"):
        asyncio.run(join())


def test_a_clock_that_goes_wrong_in_mid_mission_is_told_to_the_robot_and_so_is_its_return() -> None:
    async def trust() -> list[bool]:
        team = mission(1, clock={"ask_every_s": 0.1, "correct_up_to_s": 5.0})
        told: list[bool] = []
        async with two_computers(team, 0.0) as (fusion, here):
            await here.join_team()
            right = fusion.shell.clock
            for clock, wanted in ((TeamClock(right.epoch - 60.0), [False]), (right, [False, True])):
                fusion.shell.clock = clock
                deadline = time.monotonic() + 10.0
                while told != wanted and time.monotonic() < deadline:
                    told += [e.trusted for e in here.events() if isinstance(e, ClockTrust)]
                    await asyncio.sleep(0.02)
        return told

    assert asyncio.run(trust()) == [False, True]
