"""The command line is quick to help, says in one sentence what is wrong, and exits with a status."""

import importlib
import json
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer

from agents import cli, completion, lazy_commands
from agents.errors import LinkError, StorageError
from tests.agents import fake_kinds
from tests.agents.fake_kinds import MISSION

COMMANDS = ("swarm", "robot", "fusion", "check", "warm", "simulate", "watch", "observe")


@pytest.fixture(autouse=True)
def _only_fake_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_kinds.install(monkeypatch)


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    path = tmp_path / "test.toml"
    path.write_text(MISSION)
    return path


class Run:
    """One call of the command, in this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys

    def __call__(self, *arguments: str | Path) -> tuple[int, str, str]:
        self._monkeypatch.setattr(sys, "argv", ["searchparty", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        out, err = self._capsys.readouterr()
        return int(caught.value.code or 0), out, err


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    return Run(monkeypatch, capsys)


def replace(monkeypatch: pytest.MonkeyPatch, module: str, result: Any) -> list[dict[str, Any]]:
    """Put a stand-in in place of a module's `run` and collect its arguments."""
    calls: list[dict[str, Any]] = []

    def fake(*positional: Any, **named: Any) -> int:
        calls.append({"positional": positional, **named})
        if isinstance(result, Exception):
            raise result
        return int(result)

    stand_in = SimpleNamespace(run=fake)
    room, _, name = module.rpartition(".")
    monkeypatch.setitem(sys.modules, module, stand_in)
    monkeypatch.setattr(importlib.import_module(room), name, stand_in, raising=False)
    return calls


def test_help_lists_every_command_and_imports_nothing_heavy() -> None:
    script = (
        "import sys; sys.argv = ['searchparty', '--help']\n"
        "from agents.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'rerun', 'zenoh', 'sim', 'bridges', 'estimator'} & sys.modules.keys()\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for command in COMMANDS:
        assert f"\n  {command} " in done.stdout


@pytest.mark.parametrize("command", ["swarm", "robot", "fusion", "check", "warm"])
def test_the_help_of_each_command_has_an_example(run: Run, command: str) -> None:
    code, out, _ = run(command, "--help")
    assert code == 0
    assert f"searchparty {command}" in out.partition("Example")[2]


def test_version_is_the_packages(run: Run) -> None:
    assert run("--version") == (0, f"searchparty {version('searchparty')}\n", "")


def test_check_prints_a_mission_that_can_be_kept(run: Run, mission: Path, tmp_path: Path) -> None:
    code, out, err = run("check", mission)
    assert code == 0
    assert "right; 2 robots in 2D" in err
    kept = tmp_path / "kept.toml"
    kept.write_text(out)
    assert run("check", kept)[1] == out
    assert tomllib.loads(out)["filter"]["particles"] == 1000


def test_check_speaks_json(run: Run, mission: Path) -> None:
    code, out, _ = run("check", mission, "--json")
    answer = json.loads(out)
    assert (code, answer["ok"]) == (0, True)
    assert answer["mission"]["robots"][0]["id"] == "r1"
    mission.write_text(MISSION.replace("gain = 0.9", "gian = 0.9"))
    code, out, _ = run("check", mission, "--json")
    answer = json.loads(out)
    assert (code, answer["ok"], answer["file"]) == (2, False, str(mission))
    assert answer["problems"][0]["key"] == "robots[1].sensor.gian"
    assert answer["problems"][0]["nearest"] == "gain"


def test_a_wrong_mission_is_told_line_by_line_and_exits_2(run: Run, mission: Path) -> None:
    mission.write_text(MISSION.replace("gain = 0.9", "gian = 0.9").replace("seed = 7", "seed = -7"))
    for command in (("check",), ("swarm",), ("fusion",), ("robot", "--id", "r1")):
        code, out, err = run(command[0], mission, *command[1:])
        assert (code, out) == (2, "")
        assert f"{mission}: seed: found -7; allowed: a whole number >= 0" in err
        assert f"{mission}: robots[1].sensor.gian: found an unknown key" in err
        assert "nearest known: gain" in err


def test_what_a_plugin_refuses_exits_2(run: Run, mission: Path) -> None:
    mission.write_text(MISSION.replace("[20, 20], gain", "[20, 20, 20], gain"))
    code, _, err = run("check", mission)
    assert code == 2
    assert "robots[1].sensor: reach_m" in err


def test_a_right_mission_whose_data_is_not_here_is_right(run: Run, mission: Path, tmp_path: Path) -> None:
    mission.write_text(MISSION.replace("targets = 3", 'targets = 3\ndata = "recording"'))
    code, out, err = run("check", mission)
    assert code == 0
    assert 'data = "recording"' in out
    assert f"not to be run here: {tmp_path / 'recording'} is no directory" in err
    assert json.loads(run("check", mission, "--json")[1])["lacking"] == [
        f"{tmp_path / 'recording'} is no directory"
    ]


def test_swarm_hands_on_its_options_and_the_exit_status(
    run: Run, mission: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls = replace(monkeypatch, "agents.swarm.swarm", 1)
    options = ("--seed", "3", "--out", tmp_path / "x", "--speed", "4", "--duration", "9", "--view", "web")
    assert run("swarm", mission, *options)[0] == 1
    assert (calls[0]["positional"][0].seed, calls[0]["positional"][0].duration_s) == (3, 9.0)
    assert {key: calls[0][key] for key in ("out", "speed", "view")} == {
        "out": tmp_path / "x",
        "speed": 4.0,
        "view": "web",
    }


def test_robot_and_fusion_hand_on_their_options(
    run: Run, mission: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    robots, fusions = (
        replace(monkeypatch, f"agents.process.{name}", 0) for name in ("robot_process", "fusion_process")
    )
    assert run("robot", mission, "--id", "r2", "--connect", "tcp/a:1", "--connect", "tcp/b:1")[0] == 0
    assert robots[0]["positional"][1] == "r2"
    assert robots[0]["connect"] == ["tcp/a:1", "tcp/b:1"]
    assert run("fusion", mission, "--out", tmp_path / "new", "--speed", "2", "--seed", "5")[0] == 0
    assert (tmp_path / "new").is_dir()
    assert fusions[0]["ledger"] == tmp_path / "new" / "ledger.sqlite"
    assert (fusions[0]["speed"], fusions[0]["positional"][0].seed) == (2.0, 5)


@pytest.mark.parametrize("error", [LinkError("port 7447 is busy; free it"), StorageError("disk full")])
def test_an_expected_error_is_one_sentence_and_its_status(
    run: Run, mission: Path, monkeypatch: pytest.MonkeyPatch, error: LinkError | StorageError
) -> None:
    replace(monkeypatch, "agents.swarm.swarm", error)
    assert run("swarm", mission) == (error.exit_code, "", f"searchparty: {error}\n")


def test_an_unexpected_error_is_one_sentence_and_a_file_with_the_traceback(
    run: Run, mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace(monkeypatch, "agents.swarm.swarm", ZeroDivisionError("division by zero"))
    code, _, err = run("swarm", mission)
    assert code == 1
    assert len(err.splitlines()) == 1
    log = Path(err.partition("details in ")[2].rstrip(")\n"))
    assert "Traceback" in log.read_text()
    log.unlink()


@pytest.mark.parametrize(
    "arguments",
    [
        ("swarm",),
        ("swram", "x"),
        ("swarm", "x", "--view", "tv"),
        ("swarm", "x", "--speed", "0"),
        ("robot", "x"),
    ],
)
def test_a_wrong_command_line_exits_2(run: Run, arguments: tuple[str, ...]) -> None:
    code, _, err = run(*arguments)
    assert code == 2
    assert "Usage" in err


def test_a_command_of_another_package_is_loaded_when_it_is_used(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = []

    def greet(name: str, loud: bool = False) -> None:
        """Greet somebody."""
        typer.echo(name.upper() if loud else name)

    class Point:
        name, dist = "greet", None

        def load(self) -> Any:
            loaded.append(True)
            return greet

    point: Any = Point()
    monkeypatch.setattr(lazy_commands, "entry_points", lambda group: [point])
    code, out, _ = run("--help")
    assert (code, "greet" in out, loaded) == (0, True, [])
    assert run("greet", "you", "--loud") == (0, "YOU\n", "")
    assert loaded == [True]
    assert "Greet somebody." in run("greet", "--help")[1]


def test_missions_and_robots_are_completed(
    mission: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").mkdir()
    (tmp_path / "notes.txt").touch()
    assert completion.complete_mission("te") == ["test.toml", "tests/"]
    assert completion.complete_mission("quick") == ["quickstart"]
    assert completion.complete_mission(f"{tmp_path}/tes") == [f"{tmp_path}/test.toml", f"{tmp_path}/tests/"]
    assert completion.complete_mission("/no/such/dir/x") == []
    context: Any = SimpleNamespace(params={"mission": "test.toml"})
    assert completion.complete_robot(context, "r") == ["r1", "r2"]
    assert completion.complete_robot(SimpleNamespace(params={}), "r") == []  # type: ignore[arg-type]


def test_the_shell_gets_a_completion_script() -> None:
    import os

    environment = {**os.environ, "_SEARCHPARTY_COMPLETE": "complete_bash", "COMP_WORDS": "searchparty sw"}
    done = subprocess.run(
        [sys.executable, "-m", "agents"],
        env={**environment, "COMP_CWORD": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["swarm"]
