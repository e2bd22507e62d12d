"""The supervisor with real children."""

import asyncio
import os
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from agents.errors import SearchpartyError, StorageError
from agents.swarm import supervisor as module
from agents.swarm.processes import Command
from agents.swarm.supervisor import State, Status, Supervisor
from tests.agents.supervised_child import command

pytestmark = pytest.mark.processes


def run(commands: list[Command], directory: Path) -> list[Status]:
    """All changes until nothing more happens."""
    changes: list[Status] = []

    async def main() -> None:
        async with Supervisor(commands, directory, changes.append) as supervisor:
            await asyncio.wait_for(supervisor.wait(), 30.0)

    asyncio.run(main())
    return changes


def states(changes: list[Status]) -> list[State]:
    return [status.state for status in changes]


async def logged(directory: Path, name: str, text: str) -> None:
    async with asyncio.timeout(20.0):
        while text not in (directory / f"{name}.log").read_text():
            await asyncio.sleep(0.01)


async def reached(supervisor: Supervisor, enough: Callable[[Status], bool]) -> Status:
    async with asyncio.timeout(20.0):
        while not enough(supervisor.statuses()[0]):
            await asyncio.sleep(0.01)
    return supervisor.statuses()[0]


def alive(pid: int | None) -> bool:
    return pid is not None and psutil.pid_exists(pid)


def test_a_process_that_ends_well_is_not_restarted_even_under_always(tmp_path: Path) -> None:
    changes = run([command("r1", "exit", "0", restart="always")], tmp_path)
    assert states(changes) == [State.RUNNING, State.ENDED]
    assert changes[-1] == Status("r1", "robot", State.ENDED, None, 0, 0)


def test_never_leaves_a_dead_process_dead_and_says_its_exit_code(tmp_path: Path) -> None:
    changes = run([command("r1", "exit", "9", restart="never")], tmp_path)
    assert states(changes) == [State.RUNNING, State.DIED]
    assert changes[-1].exit_code == 9


def test_always_starts_a_failed_process_again(tmp_path: Path) -> None:
    changes = run([command("r1", "fail once", str(tmp_path / "flag"), restart="always")], tmp_path)
    assert states(changes) == [State.RUNNING, State.WAITING, State.RUNNING, State.ENDED]
    assert [status.restarts for status in changes] == [0, 0, 1, 1]
    assert changes[0].pid != changes[2].pid
    assert (tmp_path / "r1.log").read_text().count("--- ") == 2


@pytest.mark.parametrize("code", [2, 4, 5])
def test_an_error_that_would_only_repeat_is_not_tried_again(tmp_path: Path, code: int) -> None:
    assert states(run([command("r1", "exit", str(code), restart="always")], tmp_path))[-1] is State.DIED


def test_a_process_that_always_fails_at_once_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "FIRST_DELAY_S", 0.001)
    monkeypatch.setattr(module, "ATTEMPTS", 3)
    changes = run([Command("r1", "robot", ("/bin/false",), "always")], tmp_path)
    assert states(changes) == [State.RUNNING, State.WAITING] * 2 + [State.RUNNING, State.DIED]


def test_a_process_killed_from_outside_is_restarted_and_its_signal_reported(tmp_path: Path) -> None:
    async def main() -> None:
        async with Supervisor([command("r1", "plain", restart="always")], tmp_path) as supervisor:
            await logged(tmp_path, "r1", "ready")
            first = supervisor.statuses()[0].pid
            assert first is not None
            os.kill(first, signal.SIGKILL)
            status = await reached(supervisor, lambda s: s.restarts == 1 and s.state is State.RUNNING)
            assert status.exit_code == -signal.SIGKILL
            assert status.pid not in (None, first)

    asyncio.run(main())


def test_children_start_in_order_and_log_both_streams_to_their_own_file(tmp_path: Path) -> None:
    changes = run([command("b", "environment"), command("a", "exit", "0")], tmp_path)
    assert [s.name for s in changes if s.state is State.RUNNING] == ["b", "a"]
    log = (tmp_path / "b.log").read_text()
    assert "\n1 1\n" in log  # one thread each
    assert "an error line" in log
    assert "an error line" not in (tmp_path / "a.log").read_text()


def test_stop_ends_also_a_child_that_ignores_sigterm_and_leaves_no_zombie(tmp_path: Path) -> None:
    async def main() -> tuple[list[Status], float]:
        commands = [command("polite", "plain"), command("stubborn", "stubborn")]
        supervisor = Supervisor(commands, tmp_path)
        await supervisor.start()
        for name in ("polite", "stubborn"):
            await logged(tmp_path, name, "ready")
        pids = [status.pid for status in supervisor.statuses()]
        assert all(alive(pid) for pid in pids)
        began = time.monotonic()
        await supervisor.stop()
        took = time.monotonic() - began
        assert not any(alive(pid) for pid in pids)  # a zombie would still be there
        await supervisor.stop()
        return supervisor.statuses(), took

    (polite, stubborn), took = asyncio.run(main())
    assert polite.state is stubborn.state is State.STOPPED
    assert polite.exit_code == -signal.SIGTERM
    assert stubborn.exit_code == -signal.SIGKILL
    print(f"stop took {took:.3f} s")


def test_stop_while_a_process_waits_for_its_restart_starts_nothing(tmp_path: Path) -> None:
    async def main() -> Status:
        supervisor = Supervisor([command("r1", "exit", "1", restart="always")], tmp_path)
        await supervisor.start()
        await reached(supervisor, lambda s: s.state is State.WAITING)
        await supervisor.stop()
        return supervisor.statuses()[0]

    assert asyncio.run(main()) == Status("r1", "robot", State.STOPPED, None, 1, 0)


def test_a_full_disk_is_a_storage_error_that_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "r1.log").symlink_to("/dev/full")
    with pytest.raises(StorageError, match=r"r1\.log: No space left on device; make room"):
        run([command("r0", "plain"), command("r1", "plain")], tmp_path)


def test_a_log_directory_that_cannot_be_is_a_storage_error_and_ends_what_ran(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match=r"cannot write .*r1\.log"):
        run([command("r1", "plain")], tmp_path / "file" / "logs")


def test_a_program_that_is_not_there_is_an_error_that_names_the_process(tmp_path: Path) -> None:
    with pytest.raises(SearchpartyError, match="cannot start r1"):
        run([Command("r1", "robot", ("/no/such/program",), "never")], tmp_path)


def test_a_process_starts_after_one_of_the_role_that_it_waits_for_is_in_the_team(tmp_path: Path) -> None:
    team: set[str] = set()
    first = command("r1", "plain")
    second = replace(command("fusion", "plain", role="fusion"), after="robot")

    async def main() -> None:
        supervisor = Supervisor([first, second], tmp_path, joined=team.__contains__)
        starting = asyncio.create_task(supervisor.start())
        await asyncio.sleep(0.3)
        assert [s.state for s in supervisor.statuses()] == [State.RUNNING, State.NEW]
        team.add("robot")
        await asyncio.wait_for(starting, 5.0)
        assert supervisor.statuses()[1].state is State.RUNNING
        await supervisor.stop()

    asyncio.run(main())


def test_nobody_waits_for_a_process_that_has_died(tmp_path: Path) -> None:
    first, second = command("r1", "exit", "2"), command("fusion", "exit", "0", role="fusion")
    second = replace(second, after="robot")

    async def main() -> None:
        async with Supervisor([first, second], tmp_path, joined=lambda role: False) as supervisor:
            await asyncio.wait_for(supervisor.wait(), 5.0)

    began = time.monotonic()
    asyncio.run(main())
    assert time.monotonic() - began < module.JOIN_S
