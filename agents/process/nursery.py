"""A process with everything imported, rehearsed and frozen, from which a team's processes are forked.

Python, numba and the compiled kernels take a process two seconds to load; six processes on two cores would
each pay for it. Here one does, while the launcher is still reading the mission, and a fork takes
milliseconds. The nursery opens no network and starts no thread, so there is nothing a fork could tear.

Forked processes are adopted by the launcher (PR_SET_CHILD_SUBREAPER of Linux): it waits for them as for its
own, whatever becomes of the nursery. Elsewhere `Nursery.start` gives None, and processes start by themselves.
"""

import asyncio
import ctypes
import gc
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

import msgpack

from agents.process import lifeline

# One robot per process and many robots per machine: a thread pool in each would only make them wait.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)

_MESSAGE_BYTES = 65_536
_ANSWER_S = 30.0  # for a fork, behind imports and rehearsal on a busy machine
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36  # linux/prctl.h


class NurseryError(Exception):
    """The nursery cannot fork; the process must be started by itself."""


class ForkedProcess:
    """A process that was forked for this one, with the part of asyncio's Process that a supervisor uses."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._descriptor = os.pidfd_open(pid)

    def __repr__(self) -> str:
        return f"ForkedProcess({self.pid}, {self.returncode})"

    async def wait(self) -> int:
        """The exit code when it has ended; minus the signal that ended it."""
        if self.returncode is None:
            ended = asyncio.Event()
            loop = asyncio.get_running_loop()
            loop.add_reader(self._descriptor, ended.set)
            try:
                await ended.wait()
            finally:
                loop.remove_reader(self._descriptor)
            os.close(self._descriptor)
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.returncode

    def send_signal(self, number: int) -> None:
        """To this process and no other that may have its number by now."""
        if self.returncode is None:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._descriptor, number)


class Nursery:
    """The launcher's side."""

    def __init__(self, process: "subprocess.Popen[bytes]", channel: socket.socket) -> None:
        self._process = process
        self._channel = channel
        self._lock = asyncio.Lock()

    @classmethod
    def start(cls, mission: str) -> "Nursery | None":
        """Begin to import and to rehearse a mission, by file or name; at once back. None where it cannot be.

        A wrong mission is no error here: whoever starts the nursery reads the mission too, and tells.
        """
        if not sys.platform.startswith("linux") or not hasattr(os, "pidfd_open"):
            return None
        if _prctl(_PR_SET_CHILD_SUBREAPER, 1) != 0:
            return None
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "agents.process.nursery", str(theirs.fileno()), mission],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **ONE_THREAD},
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        return cls(process, ours)

    async def spawn(self, argv: Sequence[str], *, log: int, line: int) -> ForkedProcess:
        """Fork a process that runs the command line `argv` (without the program's name).

        `log` is a descriptor for its output, `line` its end of the lifeline.

        Raises:
            NurseryError: if the nursery is gone or does not answer.
        """
        async with self._lock:
            pid = await asyncio.to_thread(self._ask, list(argv), log, line)
        return ForkedProcess(pid)

    def _ask(self, argv: list[str], log: int, line: int) -> int:
        try:
            socket.send_fds(self._channel, [msgpack.packb(argv)], [log, line])
            self._channel.settimeout(_ANSWER_S)
            answer = self._channel.recv(_MESSAGE_BYTES)
        except OSError as error:
            raise NurseryError(str(error)) from error
        if not answer:
            raise NurseryError("it ended")
        return int(msgpack.unpackb(answer))

    def close(self) -> None:
        """End the nursery; what it forked lives on. A `spawn` that waits for it fails. Safe to call twice."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._channel.close()

    def __enter__(self) -> "Nursery":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def main() -> None:
    """The nursery's side: `python -m agents.process.nursery DESCRIPTOR MISSION`."""
    # No thread watches for the launcher's end here, as elsewhere: a process with threads must not fork.
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    channel = socket.socket(fileno=int(sys.argv[1]))
    _load(sys.argv[2])
    while True:
        try:
            message, descriptors, _, _ = socket.recv_fds(channel, _MESSAGE_BYTES, 2)
        except OSError:
            return
        if not message:
            return
        log, line = descriptors
        pid = _fork(channel, msgpack.unpackb(message), log, line)
        os.close(log)
        os.close(line)
        try:
            channel.send(msgpack.packb(pid))
        except OSError:
            return


def _load(mission: str) -> None:
    """Import what robots and the fusion need and do once what they will do."""
    from agents import cli  # noqa: F401, PLC0415 - only here is it wanted
    from agents.errors import SearchpartyError  # noqa: PLC0415
    from agents.mission.mission_file import load  # noqa: PLC0415
    from agents.plugins import load as plugin  # noqa: PLC0415
    from agents.process import fusion_process, robot_process  # noqa: F401, PLC0415
    from agents.process.rehearsal import rehearse_fusion, rehearse_robot  # noqa: PLC0415
    from agents.team import Team  # noqa: PLC0415
    from planner.plan import TeamPlanner  # noqa: PLC0415

    with suppress(SearchpartyError):
        loaded = load(mission)
        team = Team.of(loaded)
        plugin("transports", loaded.link.kind)
        kinds = {(str(robot.vehicle), str(robot.sensor)): robot.id for robot in loaded.robots}
        if not isinstance(team.planner, TeamPlanner):
            for robot in kinds.values():
                rehearse_robot(team, robot)
        rehearse_fusion(team)  # robots on their own need it too: what is loaded here takes no memory there
    gc.collect()
    gc.freeze()  # a collection would touch, and so copy, every page that forks share


def _fork(channel: socket.socket, argv: Sequence[str], log: int, line: int) -> int:
    """A grandchild that runs the command; its parent ends at once, so that the launcher adopts it."""
    inner, outer = os.pipe()
    parent = os.fork()
    if parent == 0:
        pid = os.fork()
        if pid == 0:
            os.close(inner)
            os.close(outer)
            channel.close()
            _become(argv, log, line)
        os.write(outer, pid.to_bytes(8, "little"))
        os._exit(0)
    os.close(outer)
    os.waitpid(parent, 0)
    pid = int.from_bytes(os.read(inner, 8), "little")
    os.close(inner)
    return pid


def _become(argv: Sequence[str], log: int, line: int) -> NoReturn:
    """Run the command line as a process that was started with it would, and end."""
    from agents import cli  # noqa: PLC0415

    code = 1
    try:
        os.setsid()
        for number in (1, 2):
            os.dup2(log, number)
        os.close(log)
        os.environ[lifeline.VARIABLE] = str(line)
        sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
        sys.argv = ["searchparty", *argv]
        _entitle(" ".join(sys.argv))
        cli.main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        # Without the interpreter's own end: it would free, and so copy, all that was shared.
        os._exit(code)


def _prctl(option: int, value: int) -> int:
    """The system call of Linux; 0 if it worked."""
    return int(ctypes.CDLL(None).prctl(option, value, 0, 0, 0))


def _entitle(title: str) -> None:
    """Let ps and top tell the processes apart."""
    from setproctitle import setproctitle  # noqa: PLC0415

    setproctitle(title)


if __name__ == "__main__":
    main()
