"""Compile all numeric kernels once, to the disk, so that no robot waits for a compiler in mid-mission."""

import time
from collections.abc import Callable, Iterable

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

Warmup = tuple[str, Callable[[], object]]  # a kernel's name, and a small call of it

QUIET_S = 4.0  # nobody needs to read about a warm-up that took no longer


def warmups() -> list[Warmup]:
    """All kernels of the estimator and the planners."""
    import estimator.warm  # noqa: PLC0415 - numba takes its time to import
    import planner.warm  # noqa: PLC0415

    return [*estimator.warm.warmups(), *planner.warm.warmups()]


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
