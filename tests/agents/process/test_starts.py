"""One team, one start: who joins, who goes on, and what two starts come to."""

import asyncio
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from agents.clock import TeamClock
from agents.errors import JoinError
from agents.ledger.ledger import Ledger
from agents.machine import ClockTrust
from agents.mission.mission_file import mission_hash
from agents.process.shell import Shell
from agents.process.starts import TeamStart
from agents.wire.messages import EventMessage, StartMessage
from agents.wire.topics import EVENT, START
from tests.agents.fakes import mission
from tests.agents.test_shell_clock import two_computers


def start_of(sender: str, epoch: float) -> StartMessage:
    team = mission(1)
    return StartMessage(
        team=team.team,
        sender=sender,
        boot="b",
        sequence=0,
        time=0.0,
        epoch=epoch,
        speed=1.0,
        seed=7,
        mission_hash=mission_hash(team),
        answers={},
    )


def team_start(name: str, epoch: float) -> TeamStart:
    shell = SimpleNamespace(name=name, clock=TeamClock(epoch), mission=mission(1))
    return TeamStart(cast(Shell, shell), Ledger(), 1.0)


def test_of_two_fusions_that_started_one_team_apart_the_later_ends_and_says_what_to_do() -> None:
    with pytest.raises(JoinError) as refused:
        team_start("fusion-2", 1012.0).compare(start_of("fusion", 1000.0))
    said = str(refused.value)
    assert "fusion had started this team 12.0 s before fusion-2 did" in said
    assert "Start it again in an empty run directory, and it joins" in said
    earlier = team_start("fusion", 1000.0)
    earlier.compare(start_of("fusion-2", 1012.0))  # that one is to end
    assert earlier._shell.clock.epoch == 1000.0


def test_fusions_of_one_start_stay() -> None:
    fusion = team_start("fusion-2", 1000.0)
    fusion.compare(start_of("fusion", 1000.0))
    fusion.compare(start_of("fusion-2", 900.0))  # its own earlier life's word, still underway
    assert fusion._shell.clock.epoch == 1000.0


def test_a_fusion_that_was_started_before_goes_on_with_its_ledgers_clock(tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        shell: Any = SimpleNamespace(name="fusion", clock=None, mission=mission(1))
        assert not TeamStart(shell, ledger, 2.0).goes_on()
        TeamStart(shell, ledger, 2.0)._remember(1234.5)
        again = TeamStart(shell, ledger, 1.0)
        assert again.goes_on()
        assert (shell.clock.epoch, again.speed) == (1234.5, 2.0)


def test_a_robot_of_the_later_start_takes_no_more_sets_and_says_that_it_is_to_be_started_again() -> None:
    async def told() -> tuple[list[bool], list[str]]:
        async with two_computers(mission(1), 0.0) as (fusion, here):
            fusion.shell.transport.subscribe(EVENT)
            here.adopt(start_of("fusion-2", time.time()))  # the one there says five seconds before
            here.transport.subscribe(START)
            trust, words = list[bool](), list[str]()
            deadline = time.monotonic() + 20.0
            while not (trust and words) and time.monotonic() < deadline:
                trust += [event.trusted for event in here.events() if isinstance(event, ClockTrust)]
                heard = fusion.heard
                words += [m.text for m in heard if isinstance(m, EventMessage)]
                await asyncio.sleep(0.02)
            return trust, words

    trust, words = asyncio.run(told())
    assert trust == [False]
    assert words == [
        "r1 follows fusion-2's start of the team, which is later than that of fusion: start it again"
    ]
