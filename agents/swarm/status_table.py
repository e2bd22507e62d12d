"""The terminal's picture of a running team: one snapshot in, one table out, at most 80 columns wide."""

from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

_SILENT_AFTER_S = 5.0  # the health topic's rate is 1 Hz
_ENDED_WELL = ("done", "stopped", "ended")
_MOST_ROWS = 24
_MOST_PROBLEMS = 3
_BAR = 76  # characters


@dataclass(frozen=True, slots=True)
class ProcessStatus:
    """What is known of one process; None where nothing is known or it makes no sense."""

    role: str  # "robot", "fusion", "watch"
    id: str
    state: str
    alive: bool  # its liveliness token stands
    age_s: float | None = None  # wall seconds since its last message
    sets_sent: int | None = None
    sets_stored: int | None = None  # of its sets, in the ledger; for the fusion, of all robots
    travelled_m: float | None = None
    restarts: int = 0
    tasks: int | None = None  # that it holds
    vehicle: str = ""  # a real one, in words


@dataclass(frozen=True, slots=True)
class TeamStatus:
    """What is known of the team at one instant."""

    mission: str
    time_s: float | None  # team time; None before the start
    duration_s: float
    found: int
    total: int | None  # true number of targets, where one is known
    expected_cardinality: float | None
    sets_applied: int
    rejected: int = 0  # messages that were not applied
    processes: tuple[ProcessStatus, ...] = ()
    note: str = ""  # one line of news
    problems: tuple[str, ...] = ()  # of the team's health, a sentence each
    alone: str = ""  # the robot whose belief this is, for want of a fusion
    held_twice_s: float = 0.0  # task-seconds that two robots held one task, as far as they knew


def status_table(status: TeamStatus) -> RenderableType:
    """A header with the mission's progress and a row for each process."""
    parts: list[RenderableType] = [_header(status)]
    if status.total:
        parts.append(_bar(status.found / status.total))
    parts.append(_processes(status))
    hidden = len(status.processes) - _MOST_ROWS
    if hidden > 0:
        parts.append(Text(f"and {hidden} more processes that are well", style="dim"))
    parts += [
        Text(f"{process.id}: {process.vehicle}", style="dim", no_wrap=True, overflow="ellipsis")
        for process in status.processes[:_MOST_ROWS]
        if process.vehicle and process.alive
    ]
    parts += [
        Text(f"! {problem}", style="yellow", no_wrap=True, overflow="ellipsis")
        for problem in status.problems[:_MOST_PROBLEMS]
    ]
    if len(status.problems) > _MOST_PROBLEMS:
        more = len(status.problems) - _MOST_PROBLEMS
        parts.append(Text(f"and {more} more problems: searchparty status tells them", style="yellow"))
    if status.note:
        parts.append(Text(status.note, style="dim", no_wrap=True, overflow="ellipsis"))
    return Group(*parts)


def _header(status: TeamStatus) -> Text:
    total = "?" if status.total is None else str(status.total)
    done = status.total is not None and status.found >= status.total
    clock = "not started" if status.time_s is None else f"{status.time_s:.0f} / {status.duration_s:.0f} s"
    expected = "-" if status.expected_cardinality is None else f"{status.expected_cardinality:.1f}"
    line = Text(no_wrap=True, overflow="ellipsis")
    line.append(status.mission, style="bold")
    line.append(f"  {clock}  found ")
    line.append(f"{status.found}/{total}", style="bold green" if done or status.found else "bold")
    line.append(f"  expected {expected}  sets {status.sets_applied}")
    if status.alone:
        line.append(f"  no fusion: as {status.alone} believes", style="yellow")
    if status.rejected:
        line.append(f"  rejected {status.rejected}", style="yellow")
    if status.held_twice_s >= 0.05:
        line.append(f"  tasks held twice {status.held_twice_s:.1f} s", style="yellow")
    return line


def _bar(share: float) -> Text:
    done = round(_BAR * min(share, 1.0))
    return Text.assemble(("━" * done, "green"), ("━" * (_BAR - done), "bright_black"))


def _processes(status: TeamStatus) -> Table:
    table = Table(box=None, padding=(0, 1), header_style="dim", pad_edge=False)
    table.add_column("process", no_wrap=True, min_width=12, max_width=20)
    share = any(process.tasks is not None for process in status.processes)
    table.add_column("state", no_wrap=True, min_width=10 if share else 12, max_width=18)
    sets = ("sent", "stored", "tasks") if share else ("sets sent", "stored")
    for name in ("age", *sets, "travelled", "restarts"):
        table.add_column(name, justify="right", no_wrap=True)
    # With more processes than rows, those in trouble are shown first and nothing else moves.
    rows = sorted(status.processes, key=_is_well) if len(status.processes) > _MOST_ROWS else status.processes
    for process in rows[:_MOST_ROWS]:
        table.add_row(
            Text(process.id if process.role == process.id else f"{process.role} {process.id}"),
            _state(process),
            _age(process),
            _count(process.sets_sent),
            _count(process.sets_stored),
            *((_count(process.tasks if process.alive else None),) if share else ()),
            "-" if process.travelled_m is None else f"{process.travelled_m:.0f} m",
            Text(str(process.restarts), style="yellow") if process.restarts else Text("-", style="dim"),
        )
    return table


def _is_well(process: ProcessStatus) -> bool:
    return process.alive and (process.age_s is None or process.age_s < _SILENT_AFTER_S)


def _state(process: ProcessStatus) -> Text:
    if not process.alive:
        ended = process.state in _ENDED_WELL
        return Text(process.state if ended else "gone", style="dim" if ended else "bold red")
    if not _is_well(process):
        return Text("silent", style="bold yellow")
    return Text(process.state or "-", style="" if process.state else "dim")


def _age(process: ProcessStatus) -> Text:
    if process.age_s is None:
        return Text("-", style="dim")
    return Text(f"{process.age_s:.1f} s", style="" if process.age_s < _SILENT_AFTER_S else "yellow")


def _count(value: int | None) -> Text:
    return Text("-", style="dim") if value is None else Text(str(value))
