"""Where a recording goes: to a file, to a viewer on this machine, or both; none of it can hang the process.

A viewer that is slow makes Rerun's log calls wait. So only the view's own process logs, and `close` has a
deadline: a viewer that does not take its data by then is ended, which frees whoever waited for it.
"""

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Literal

import rerun as rr
import rerun.blueprint as rrb
import rerun_cli  # type: ignore[import-untyped]

from agents.errors import LinkError, StorageError

Mode = Literal["none", "spawn", "web"]

_MEMORY = "25%"
_RECORD_S = 10.0  # of a recording that nobody watches are written at once, and lost if the process is killed


def has_display() -> bool:
    """Whether a window could be opened here."""
    if sys.platform in {"darwin", "win32"}:
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class RerunOutput:
    """A recording stream with its sinks and, in the modes "spawn" and "web", the viewer process.

    Raises:
        StorageError: if the file cannot be written.
        LinkError: if the viewer does not start, or there is no display for a window.
    """

    def __init__(self, name: str, layout: rrb.Blueprint, *, record: Path | None, mode: Mode) -> None:
        if mode == "spawn" and not has_display():
            raise LinkError(
                "no display for the viewer's window; use --view web, or --view none and --record FILE"
            )
        self.url: str | None = None
        self._viewer: subprocess.Popen[bytes] | None = None
        self.stream = rr.RecordingStream("searchparty", batcher_config=_batches(live=mode != "none"))
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        if record is not None:
            sinks.append(_file(record))
        if mode != "none":
            sinks.append(self._start_viewer(mode))
        if not sinks:  # Rerun would keep all that is logged
            sinks.append(rr.FileSink(os.devnull))
        self.stream.set_sinks(*sinks, default_blueprint=layout)
        self.stream.send_recording_name(name)

    def __repr__(self) -> str:
        return f"RerunOutput(url={self.url!r}, viewer={self.viewer_pid})"

    @property
    def viewer_pid(self) -> int | None:
        """The viewer's process, if there is one."""
        return None if self._viewer is None else self._viewer.pid

    def close(self, timeout: float = 1.5) -> None:
        """Write everything out and end the viewer, within about `timeout` seconds. Safe to call twice."""
        writer = threading.Thread(target=self._flush, args=(timeout,), daemon=True)
        writer.start()
        writer.join(timeout)
        if self._viewer is not None and self._viewer.poll() is None:
            if writer.is_alive():
                self._viewer.kill()
            else:
                self._viewer.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._viewer.wait(0.3)
            if self._viewer.poll() is None:
                self._viewer.kill()
        writer.join(0.2)

    def _flush(self, timeout: float) -> None:
        with contextlib.suppress(Exception):  # a dead viewer must not cost the file its end
            self.stream.flush(timeout_sec=0.8 * timeout)
        with contextlib.suppress(Exception):
            self.stream.disconnect()

    def _start_viewer(self, mode: Mode) -> rr.GrpcSink:
        port = _free_port()
        command = [str(_binary()), "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", _MEMORY]
        if mode == "web":
            web = _free_port()
            command += ["--serve-web", "--web-viewer-port", str(web), "--server-memory-limit", _MEMORY]
            self.url = f"http://127.0.0.1:{web}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port}%2Fproxy"
        else:
            command += ["--expect-data-soon", "--hide-welcome-screen"]
        environment = {**os.environ, "RERUN_APP_ONLY": "true"}
        try:
            self._viewer = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=environment,
                preexec_fn=_end_with_parent if sys.platform == "linux" else None,  # noqa: PLW1509 - no threads yet
            )
        except OSError as error:
            raise LinkError(f"the Rerun viewer does not start ({error}); use --view none") from None
        return rr.GrpcSink(f"rerun+http://127.0.0.1:{port}/proxy")


def _batches(*, live: bool) -> rr.ChunkBatcherConfig:
    """How much is written at a time. A file of thousands of tiny chunks is larger, and slow to open."""
    return rr.ChunkBatcherConfig.DEFAULT() if live else rr.ChunkBatcherConfig(flush_tick=_RECORD_S)


def _file(path: Path) -> rr.FileSink:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb"):
            pass
        return rr.FileSink(path)
    except OSError as error:
        raise StorageError(f"cannot write the recording {path}: {error.strerror or error}") from None


def _binary() -> Path:
    """The viewer itself. The `rerun` script only wraps it, and would leave it running when ended."""
    override = os.environ.get("RERUN_CLI_PATH")
    if override:
        return Path(override)
    return Path(rerun_cli.__file__).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")


def _end_with_parent() -> None:
    """In the child: be ended when the parent is, even by SIGKILL."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
