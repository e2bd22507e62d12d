"""Compile all numeric kernels once, to the disk, so that no robot waits for a compiler in mid-mission.

A stamp beside the compiled kernels says for which code and compiler they were made, so that looking whether
there is anything to do takes milliseconds and not the seconds that loading them all does.
"""

import hashlib
import os
import platform
import time
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

Warmup = tuple[str, Callable[[], object]]  # a kernel's name, and a small call of it

QUIET_S = 4.0  # nobody needs to read about a warm-up that took no longer


def warmups() -> list[Warmup]:
    """All kernels of the estimator and the planners."""
    import estimator.warm  # noqa: PLC0415 - numba takes its time to import
    import planner.warm  # noqa: PLC0415

    return [*estimator.warm.warmups(), *planner.warm.warmups()]


def ensure(console: Console) -> None:
    """Compile what was not compiled for this code on this machine; at once when all was."""
    stamp = _stamp()
    if stamp.exists():
        return
    run(console)
    try:
        stamp.parent.mkdir(parents=True, exist_ok=True)
        stamp.touch()
    except OSError:
        pass  # a place that cannot be written costs the next start some seconds, no more


def _stamp() -> Path:
    """The file that stands for kernels of this code, numba, Python and machine."""
    here = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(f"{version('numba')} {platform.python_version()} {platform.node()}".encode())
    for path in sorted([*here.glob("estimator/**/*.py"), *here.glob("planner/**/*.py")]):
        digest.update(path.read_bytes())
    cache = os.environ.get("NUMBA_CACHE_DIR")
    directory = Path(cache) if cache else here / "estimator" / "__pycache__"
    return directory / f"searchparty-{digest.hexdigest()[:16]}.warm"


def run(console: Console, find: Callable[[], Iterable[Warmup]] = warmups) -> None:
    """Call each kernel once, with a progress bar on `console`; says nothing when all were compiled before."""
    began = time.monotonic()
    columns = (
        TextColumn("compiling kernels"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    bar = Progress(*columns, console=console, transient=True)
    todo = list(find())
    task = bar.add_task("", total=len(todo))
    try:
        for name, call in todo:
            if time.monotonic() - began > QUIET_S:
                bar.start()
            bar.update(task, description=name)
            call()
            bar.advance(task)
    finally:
        if bar.live.is_started:  # else stopping would print an empty line
            bar.stop()
    took = time.monotonic() - began
    if took > QUIET_S:
        console.print(f"{len(todo)} kernels ready after {took:.0f} s")
