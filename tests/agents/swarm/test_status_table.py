"""The terminal's table."""

import io
from dataclasses import replace

from rich.console import Console

from agents.swarm.status_table import ProcessStatus, TeamStatus, status_table


def text(status: TeamStatus, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(status_table(status))
    output = console.file.getvalue()  # type: ignore[attr-defined]
    assert all(len(line) <= width for line in output.splitlines())
    return str(output)


def team(*processes: ProcessStatus, total: int | None = 10, note: str = "") -> TeamStatus:
    return TeamStatus("quickstart", 61.7, 300.0, 4, total, 8.26, 240, 2, processes, note)


def test_header_and_rows_say_how_the_team_stands_in_80_columns() -> None:
    robot = ProcessStatus("robot", "r1", "moving", True, 0.23, 62, 61, 412.4, 1)

    output = text(team(robot, ProcessStatus("fusion", "fusion", "running", True, 0.1), note="n" * 200))

    for part in ("quickstart", "62 / 300 s", "4/10", "8.3", "240", "rejected 2"):
        assert part in output
    row = next(line for line in output.splitlines() if "r1" in line)
    assert row.split() == ["robot", "r1", "moving", "0.2", "s", "62", "61", "412", "m", "1"]


def test_gone_and_silent_processes_are_called_so() -> None:
    gone = ProcessStatus("robot", "r1", "moving", False, 3.0)
    silent = ProcessStatus("robot", "r2", "moving", True, 30.0)

    lines = text(team(gone, silent)).splitlines()

    assert "gone" in next(line for line in lines if "r1" in line)
    assert "silent" in next(line for line in lines if "r2" in line)


def test_process_that_was_told_to_end_is_not_called_gone() -> None:
    assert "gone" not in text(team(ProcessStatus("robot", "r1", "stopped", False, 3.0)))


def test_of_many_processes_those_in_trouble_are_shown() -> None:
    well = [ProcessStatus("robot", f"r{i}", "moving", True, 0.1) for i in range(49)]

    output = text(team(*well, ProcessStatus("robot", "r99", "moving", False)))

    assert "r99" in output
    assert "26 more" in output


def test_unknown_truth_and_time_are_shown_as_unknown() -> None:
    output = text(TeamStatus("mrclam", None, 900.0, 0, None, None, 0))

    assert "not started" in output
    assert "0/?" in output


def test_what_is_wrong_stands_below_in_sentences_and_most_of_many_is_counted() -> None:
    status = replace(team(), problems=tuple(f"robot r{i} is not there" for i in range(9)))

    output = text(status)

    assert "! robot r0 is not there" in output
    assert "r3 is not there" not in output
    assert "and 6 more problems" in output


def test_where_robots_share_tasks_it_says_how_many_each_holds_and_what_was_held_twice() -> None:
    one = ProcessStatus("robot", "survey1", "moving", True, 0.23, 162, 161, 412.4, 1, 3)
    dead = ProcessStatus("robot", "survey2", "moving", False, 9.0, 62, 61, 99.0, 0, 4)
    status = TeamStatus("tasks", 61.7, 300.0, 4, 8, 8.26, 240, 0, (one, dead), held_twice_s=1.26)
    lines = text(status).splitlines()
    assert "tasks held twice 1.3 s" in lines[0]
    assert next(line for line in lines if line.startswith("process")).split()[-5:] == [
        *("sent", "stored", "tasks", "travelled", "restarts")
    ]
    assert next(line for line in lines if "survey1" in line).split()[-4:] == ["3", "412", "m", "1"]
    assert next(line for line in lines if "survey2" in line).split()[-4:] == ["-", "99", "m", "-"]
