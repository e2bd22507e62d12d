"""Processes forked from a loaded one behave as if they had been started by themselves."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from agents.mission.mission_file import load
from agents.plugins import load as plugin
from agents.process.lifeline import Lifeline
from agents.process.nursery import ForkedProcess, Nursery, NurseryError
from agents.swarm.processes import PROGRAM, Command
from agents.swarm.supervisor import State, Supervisor

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux adopts grandchildren"),
]
MISSION = str(Path(__file__).parents[3] / "missions" / "quickstart.toml")


@pytest.fixture
def nursery() -> Iterator[Nursery]:
    started = Nursery.start(MISSION)
    assert started is not None
    with started:
        yield started


async def run(nursery: Nursery, log: Path, *argv: str) -> ForkedProcess:
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    try:
        with Lifeline() as line:
            process = await nursery.spawn(argv, log=descriptor, line=line.read_end)
            await process.wait()
    finally:
        os.close(descriptor)
    return process


def test_a_forked_command_writes_its_log_and_ends_with_its_own_exit_code(
    nursery: Nursery, tmp_path: Path
) -> None:
    async def main() -> list[int | None]:
        good = await run(nursery, tmp_path / "good.log", "check", MISSION)
        bad = await run(nursery, tmp_path / "bad.log", "check", str(tmp_path / "none.toml"))
        return [good.returncode, bad.returncode]

    assert asyncio.run(main()) == [0, 2]
    assert 'name = "quickstart"' in (tmp_path / "good.log").read_text()
    assert "none.toml" in (tmp_path / "bad.log").read_text()


def test_nothing_that_forks_has_a_second_thread(nursery: Nursery, tmp_path: Path) -> None:
    asyncio.run(run(nursery, tmp_path / "log", "--version"))  # so that all is loaded
    assert len(os.listdir(f"/proc/{nursery._process.pid}/task")) == 1


def test_a_forked_process_goes_by_its_command_and_leaves_with_its_lifeline(
    nursery: Nursery, tmp_path: Path
) -> None:
    async def main(endpoint: str) -> int:
        descriptor = os.open(tmp_path / "log", os.O_WRONLY | os.O_CREAT)
        line = Lifeline()
        argv = ("robot", MISSION, "--id", "r1", "--connect", endpoint)
        process = await nursery.spawn(argv, log=descriptor, line=line.read_end)
        os.close(descriptor)
        async with asyncio.timeout(20.0):
            while "waiting for the fusion" not in (tmp_path / "log").read_text():
                await asyncio.sleep(0.01)
        shown = " ".join(psutil.Process(process.pid).cmdline()).rstrip()  # the title may be padded
        assert shown == " ".join(("searchparty", *argv))
        line.close()
        async with asyncio.timeout(10.0):
            return await process.wait()

    mission = load(MISSION)
    with plugin("routers", mission.link.kind)(mission.link) as router:
        assert asyncio.run(main(router.endpoints[0])) == 0


def test_without_its_nursery_a_process_starts_by_itself(nursery: Nursery, tmp_path: Path) -> None:
    command = Command("r1", "robot", (*PROGRAM, "--version"), "never", forked=True)

    async def main() -> State:
        psutil.Process(nursery._process.pid).kill()
        async with Supervisor([command], tmp_path, nursery=nursery) as supervisor:
            await asyncio.wait_for(supervisor.wait(), 30.0)
            return supervisor.statuses()[0].state

    assert asyncio.run(main()) is State.ENDED
    assert "searchparty 0" in (tmp_path / "r1.log").read_text()


def test_a_closed_nursery_answers_with_an_error(nursery: Nursery, tmp_path: Path) -> None:
    nursery.close()
    with pytest.raises(NurseryError):
        asyncio.run(run(nursery, tmp_path / "log", "--version"))


def test_a_nursery_ends_with_a_launcher_that_was_killed() -> None:
    code = (
        "import sys, time\nfrom agents.process.nursery import Nursery\n"
        f"print(Nursery.start({MISSION!r})._process.pid, flush=True)\ntime.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as launcher:
        assert launcher.stdout is not None
        child = psutil.Process(int(launcher.stdout.readline()))
        while "agents.process.nursery" not in " ".join(child.cmdline()):
            time.sleep(0.01)
        launcher.send_signal(signal.SIGKILL)
    _, alive = psutil.wait_procs([child], timeout=5.0)
    assert not alive
