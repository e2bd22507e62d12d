"""Compile numeric kernels once, to the disk, so that no robot waits for a compiler in mid-mission.

A stamp beside the compiled kernels says for which code, compiler and mission they were made, so that looking
whether there is anything to do takes milliseconds and not the seconds that loading them all does.
"""

import hashlib
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from agents.mission.mission import Mission

Warmup = tuple[str, Callable[[], object]]  # what it is for, and a small call of its kernels

QUIET_S = 4.0  # nobody needs to read about a warm-up that took no longer


def warmups() -> list[Warmup]:
    """All kernels of the estimator and the planners."""
    import estimator.warm  # noqa: PLC0415 - numba takes its time to import
    import planner.warm  # noqa: PLC0415

    return [*estimator.warm.warmups(), *planner.warm.warmups()]


def mission_warmups(mission: Mission) -> list[Warmup]:
    """What the processes of one mission will do: their rehearsals, each pair of vehicle and sensor once."""
    from functools import partial  # noqa: PLC0415

    from agents.process.rehearsal import rehearse_fusion, rehearse_robot  # noqa: PLC0415
    from agents.team import Team  # noqa: PLC0415

    team = Team.of(mission)
    kinds = {(str(robot.vehicle), str(robot.sensor)): robot.id for robot in mission.robots}
    robots = [(f"robot {robot}", partial(rehearse_robot, team, robot)) for robot in kinds.values()]
    return [*robots, ("fusion", partial(rehearse_fusion, team))]


def ensure(console: Console, mission: Mission | None = None) -> None:
    """Compile what was not compiled for this code on this machine, for one mission or for all."""
    everything = _stamp("everything")
    stamp = everything if mission is None else _stamp(_essence(mission))
    if stamp.exists() or everything.exists():
        return
    run(console, warmups if mission is None else lambda: mission_warmups(mission))
    try:
        stamp.parent.mkdir(parents=True, exist_ok=True)
        stamp.touch()
    except OSError:
        pass  # a place that cannot be written costs the next start some seconds, no more


def _essence(mission: Mission) -> str:
    """A mission without what needs no other kernels."""
    plain = msgspec.structs.replace(mission, seed=0, duration_s=1.0, name="any", description="")
    return hashlib.sha256(repr(plain).encode()).hexdigest()


def _stamp(what: str) -> Path:
    """The file that stands for kernels of this code, numba, Python and machine."""
    here = Path(__file__).resolve().parents[2]
    words = f"{version('numba')} {platform.python_version()} {platform.node()} {what}"
    digest = hashlib.sha256(words.encode())
    for path in sorted([*here.glob("estimator/**/*.py"), *here.glob("planner/**/*.py")]):
        digest.update(path.read_bytes())
    cache = os.environ.get("NUMBA_CACHE_DIR")
    directory = Path(cache) if cache else here / "estimator" / "__pycache__"
    return directory / f"searchparty-{digest.hexdigest()[:16]}.warm"


def run(console: Console, find: Callable[[], Sequence[Warmup]] = warmups, workers: int | None = None) -> None:
    """Make each call once, with a progress bar on `console`; says nothing when all were compiled before.

    Calls are shared out to `workers` processes, by default one per core. Those whose names differ only after
    the comma ("K-means, 2D" and "K-means, 3D") compile the same for the most part, and so are made by one.
    """
    began = time.monotonic()
    columns = (
        TextColumn("compiling kernels"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    bar = Progress(*columns, console=console, transient=True)
    families: dict[str, list[Callable[[], object]]] = {}
    for name, call in find():
        families.setdefault(name.split(",")[0], []).append(call)
    task = bar.add_task("", total=len(families))
    try:
        for name in _done(families, workers or os.cpu_count() or 1):
            if time.monotonic() - began > QUIET_S:
                bar.start()
            bar.update(task, description=name, advance=1)
    finally:
        if bar.live.is_started:  # else stopping would print an empty line
            bar.stop()
    took = time.monotonic() - began
    if took > QUIET_S:
        console.print(f"kernels ready after {took:.0f} s")


def _done(families: Mapping[str, Sequence[Callable[[], object]]], workers: int) -> Iterable[str]:
    """The names of the families, each when its calls were made."""
    # Forked, so that the workers hold what is loaded already. All start at the first submit, before the
    # progress bar's thread does.
    with ProcessPoolExecutor(min(workers, len(families)), mp_context=get_context("fork")) as pool:
        futures = {pool.submit(_make, calls): name for name, calls in families.items()}
        for future in as_completed(futures):
            future.result()
            yield futures[future]


def _make(calls: Sequence[Callable[[], object]]) -> None:
    for call in calls:
        call()
