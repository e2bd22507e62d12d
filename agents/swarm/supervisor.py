"""Run the processes of a team as children: start in order, log, restart, and end them all.

No child outlives the supervisor: `stop` ends them within two seconds, and when the launcher itself is killed
their lifeline breaks (agents.process.lifeline).
"""

import asyncio
import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Self

from agents.errors import DataError, JoinError, MissionError, SearchpartyError, StorageError
from agents.process.lifeline import Lifeline
from agents.process.nursery import ONE_THREAD, ForkedProcess, Nursery, NurseryError
from agents.swarm.processes import Command

JOIN_S = 10.0  # for which a process waits for the one that it starts after
TERMINATE_S = 1.5  # from SIGTERM to SIGKILL
FIRST_DELAY_S = 0.25
LONGEST_DELAY_S = 5.0
SETTLED_S = 10.0  # a process that ran this long may fail anew
ATTEMPTS = 8  # failures in a row, none of them settled, before it is given up

# Ends that another start would only repeat.
_FINAL = {0, MissionError.exit_code, JoinError.exit_code, DataError.exit_code, StorageError.exit_code}


class State(Enum):
    """How a child is."""

    NEW = "new"
    RUNNING = "running"
    WAITING = "waiting"  # died, will be started again
    ENDED = "ended"  # of itself, with exit code 0
    DIED = "died"  # and is left so
    STOPPED = "stopped"  # by us


@dataclass(frozen=True, slots=True)
class Status:
    """One line of the launcher's table."""

    name: str
    role: str
    state: State = State.NEW
    pid: int | None = None
    exit_code: int | None = None  # of the last end; negative: minus the signal
    restarts: int = 0
    detail: str = ""

    @property
    def final(self) -> bool:
        """Nothing more will happen to it."""
        return self.state in (State.ENDED, State.DIED, State.STOPPED)


class _Child:
    """One command's process over all its restarts."""

    def __init__(self, command: Command) -> None:
        self.command = command
        self.status = Status(command.name, command.role)
        self.process: asyncio.subprocess.Process | ForkedProcess | None = None
        self.task: asyncio.Task[None] | None = None


class Supervisor:
    """The children of one launcher. `on_change` is called, in the event loop, at each change of a status."""

    def __init__(
        self,
        commands: Sequence[Command],
        log_directory: Path,
        on_change: Callable[[Status], None] = lambda status: None,
        *,
        environment: Mapping[str, str] | None = None,
        nursery: Nursery | None = None,
        joined: Callable[[str], bool] = lambda role: True,
    ) -> None:
        """With a `nursery`, which then is the supervisor's to close, what can be is forked from it.

        `joined` tells whether one of a role is in the team: what starts after it waits for that.
        """
        self._children = {command.name: _Child(command) for command in commands}
        if len(self._children) != len(commands):
            raise ValueError("two processes of one name")
        self._logs = log_directory
        self._on_change = on_change
        self._environment = {**os.environ, **ONE_THREAD, "PYTHONUNBUFFERED": "1", **(environment or {})}
        self._nursery = nursery
        self._joined = joined
        self._lifeline: Lifeline | None = None
        self._stopping = asyncio.Event()

    def __repr__(self) -> str:
        states = ", ".join(f"{s.name} {s.state.value}" for s in self.statuses())
        return f"Supervisor({states})"

    def statuses(self) -> list[Status]:
        """One for each command, in start order."""
        return [child.status for child in self._children.values()]

    async def start(self) -> None:
        """Start all, in order.

        Raises:
            StorageError: if a log file cannot be written. SearchpartyError: if a process cannot be started.
                What was started already is ended then.
        """
        self._lifeline = Lifeline()
        try:
            for child in self._children.values():
                await self._wait_for(child.command.after)
                await self._spawn(child)
                child.task = asyncio.create_task(self._look_after(child), name=f"child {child.command.name}")
        except BaseException:
            await self.stop()
            raise

    async def wait(self) -> None:
        """Return when all have ended and none will be started again."""
        await asyncio.gather(*(child.task for child in self._children.values() if child.task is not None))

    async def stop(self) -> None:
        """End all that run, by SIGTERM and `TERMINATE_S` later by SIGKILL. Safe to call twice."""
        self._stopping.set()
        if self._nursery is not None:
            self._nursery.close()
        tasks = [child.task for child in self._children.values() if child.task is not None]
        for child in self._children.values():
            _send(child, signal.SIGTERM)
        if tasks:
            await asyncio.wait(tasks, timeout=TERMINATE_S)
        for child in self._children.values():
            _send(child, signal.SIGKILL)
        await asyncio.gather(*tasks)
        if self._lifeline is not None:
            self._lifeline.close()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self.stop()

    async def _wait_for(self, role: str) -> None:
        """Until one of a role is in the team, or never will be, or it takes too long."""
        until = time.monotonic() + JOIN_S
        while role and not self._joined(role) and time.monotonic() < until and not self._stopping.is_set():
            if all(status.final for status in self.statuses() if status.role == role):
                return
            await asyncio.sleep(0.02)

    async def _look_after(self, child: _Child) -> None:
        """Wait for the end of a process that runs, and start it again as its command says."""
        failures = 0
        while child.process is not None:
            started = time.monotonic()
            code = await child.process.wait()
            child.process = None
            failures = 1 if time.monotonic() - started > SETTLED_S else failures + 1
            state = self._after(child.command, code, failures)
            self._set(child, replace(child.status, state=state, pid=None, exit_code=code))
            if state is not State.WAITING:
                return
            delay = min(LONGEST_DELAY_S, FIRST_DELAY_S * 2 ** (failures - 1))
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stopping.wait(), delay)
            if self._stopping.is_set():
                self._set(child, replace(child.status, state=State.STOPPED))
                return
            child.status = replace(child.status, restarts=child.status.restarts + 1)
            try:
                await self._spawn(child)
            except SearchpartyError as error:
                self._set(child, replace(child.status, state=State.DIED, detail=str(error)))

    def _after(self, command: Command, code: int, failures: int) -> State:
        if self._stopping.is_set():
            return State.STOPPED
        if code == 0:
            return State.ENDED
        again = command.restart == "always" and code not in _FINAL and failures < ATTEMPTS
        return State.WAITING if again else State.DIED

    async def _spawn(self, child: _Child) -> None:
        command, lifeline = child.command, self._lifeline
        assert lifeline is not None
        log = self._open_log(command)
        try:
            child.process = await self._forked(command, log, lifeline)
            if child.process is None:
                if self._stopping.is_set():
                    raise SearchpartyError(f"{command.name} was stopped before it started")
                child.process = await asyncio.create_subprocess_exec(
                    *command.argv,
                    stdin=asyncio.subprocess.DEVNULL,
                    stdout=log,
                    stderr=asyncio.subprocess.STDOUT,
                    env={**self._environment, **lifeline.environment},
                    pass_fds=(lifeline.read_end,),
                    start_new_session=True,  # Ctrl-C in the terminal is for the launcher, which then ends us
                )
        except OSError as error:
            raise SearchpartyError(f"cannot start {command.name}: {error.strerror}") from error
        finally:
            os.close(log)
        self._set(child, replace(child.status, state=State.RUNNING, pid=child.process.pid))
        if self._stopping.is_set():  # while it was being started
            _send(child, signal.SIGTERM)

    async def _forked(self, command: Command, log: int, lifeline: Lifeline) -> ForkedProcess | None:
        """The command's process out of the nursery; None if it must be started by itself."""
        if self._nursery is None or not command.forked:
            return None
        try:
            return await self._nursery.spawn(command.arguments, log=log, line=lifeline.read_end)
        except NurseryError:
            self._nursery.close()
            self._nursery = None
            return None

    def _open_log(self, command: Command) -> int:
        """The log's descriptor, after a first line, so that a full disk shows here and not in the child."""
        path = self._logs / f"{command.name}.log"
        line = f"--- {time.strftime('%Y-%m-%d %H:%M:%S')} {' '.join(command.argv)}\n"
        try:
            self._logs.mkdir(parents=True, exist_ok=True)
            log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            try:
                os.write(log, line.encode())
            except OSError:
                os.close(log)
                raise
        except OSError as error:
            raise StorageError(
                f"cannot write {path}: {error.strerror}; make room, or choose another directory with --out"
            ) from error
        return log

    def _set(self, child: _Child, status: Status) -> None:
        child.status = status
        self._on_change(status)


def _send(child: _Child, number: signal.Signals) -> None:
    """Signal a child that runs. SIGKILL goes to its whole session, for what it may have started itself."""
    process = child.process
    if process is None or process.returncode is not None:
        return
    with suppress(ProcessLookupError):
        if number is signal.SIGKILL:
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
