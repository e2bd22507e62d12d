"""The README's commands do what it says."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
COMMANDS = [
    line.split("#")[0].strip()
    for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
]
RUNNABLE = [c for c in COMMANDS if c.startswith("searchparty ") and "HOST" not in c]


def test_the_first_two_commands_are_the_two_to_know() -> None:
    assert COMMANDS[:2] == ["make demo", "make test"]


@pytest.mark.parametrize("target", ["demo", "test", "setup", "bench"])
def test_make_knows_what_the_readme_names(target: str) -> None:
    subprocess.run(["make", "--dry-run", target], cwd=ROOT, check=True, capture_output=True)


def test_the_demo_runs_the_quickstart() -> None:
    shown = subprocess.run(
        ["make", "--dry-run", "demo"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    assert "swarm missions/quickstart.toml" in shown


@pytest.mark.processes
@pytest.mark.timeout(200)
@pytest.mark.parametrize("command", RUNNABLE)
def test_commands_run_as_written(command: str, tmp_path: Path) -> None:
    words = shlex.split(command)[1:]
    ended = subprocess.run(
        [sys.executable, "-m", "agents.cli", *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.parametrize("command", [c for c in COMMANDS if "HOST" in c])
def test_commands_for_many_hosts_name_real_options(command: str) -> None:
    words = shlex.split(command)
    shown = subprocess.run(
        [sys.executable, "-m", "agents.cli", words[1], "--help"], capture_output=True, text=True, check=True
    ).stdout
    for word in words[2:]:
        if word.startswith("--"):
            assert word in shown


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda p: p.name
)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        if not link.startswith("http"):
            assert (page.parent / link).exists(), f"{page.name} links to {link}"
