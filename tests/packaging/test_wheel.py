"""The built package works where no checkout is: its contents, and its command in a clean environment."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("agents", "estimator", "planner", "bridges", "sim")


def run(*command: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    return subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout, built without any network."""
    directory = tmp_path_factory.mktemp("wheel")
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--wheel-dir", directory)
    done = run(sys.executable, "-m", "pip", "wheel", *options, ROOT)
    assert done.returncode == 0, done.stderr
    (path,) = directory.glob("searchparty-*.whl")
    return path


def share_kernels(site: Path) -> None:
    """Hand on the checkout's compiled kernels: numba takes them where sources have the same age and size."""
    for source in (path for room in ("estimator", "planner") for path in (ROOT / room).rglob("*")):
        copy = site / source.relative_to(ROOT)
        if source.suffix == ".py" and copy.exists():
            os.utime(copy, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
        elif source.suffix in (".nbi", ".nbc", ".warm"):
            copy.parent.mkdir(exist_ok=True)
            shutil.copy2(source, copy)


@pytest.fixture(scope="module")
def clean(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin directory of an environment that holds the wheel, and sees only our dependencies beside it."""
    directory = tmp_path_factory.mktemp("clean") / "venv"
    venv.create(directory, with_pip=False)
    python = directory / "bin" / "python"
    done = run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel)
    assert done.returncode == 0, done.stderr
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip())
    # A directory named in a .pth file is searched, but the .pth files in it (our editable install) are not.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    share_kernels(site)
    return directory / "bin"


def test_the_wheel_holds_rooms_types_missions_and_licence(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    for room in ROOMS:
        assert {f"{room}/__init__.py", f"{room}/py.typed"} <= names
    shipped = {name.removeprefix("agents/") for name in names if name.startswith("agents/missions/")}
    assert shipped == {f"missions/{path.name}" for path in (ROOT / "missions").iterdir()}
    assert any(name.endswith("dist-info/licenses/LICENSE") for name in names)


def test_the_wheel_holds_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as file:
        tops = {name.partition("/")[0] for name in file.namelist()}
        assert {top for top in tops if not top.endswith(".dist-info")} == set(ROOMS)
        assert not [name for name in file.namelist() if "__pycache__" in name or name.endswith(".nbi")]


def test_an_installed_example_is_checked_outside_the_checkout(clean: Path, tmp_path: Path) -> None:
    done = run(clean / "searchparty", "check", "quickstart", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert 'name = "quickstart"' in done.stdout


def test_the_installed_command_is_the_wheels(clean: Path, tmp_path: Path) -> None:
    where = run(clean / "python", "-c", "import agents, sim; print(agents.__file__)", cwd=tmp_path).stdout
    assert where.startswith(str(clean.parent))
    listed = run(clean / "searchparty", "--help", cwd=tmp_path).stdout
    assert "simulate" in listed
    assert "watch" in listed


def test_an_unknown_mission_names_the_installed_examples(clean: Path, tmp_path: Path) -> None:
    done = run(clean / "searchparty", "check", "quickstrat", cwd=tmp_path)
    assert done.returncode == 2
    assert "nearest is quickstart" in done.stderr


@pytest.mark.processes
@pytest.mark.timeout(580)  # where the checkout's kernels were not compiled they are now
def test_an_installed_example_finds_its_targets_outside_the_checkout(clean: Path, tmp_path: Path) -> None:
    options = ("--speed", "4", "--view", "none", "--out", tmp_path / "run")
    done = run(clean / "searchparty", "swarm", "quickstart", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "12 of 12 targets found" in done.stdout
    assert (tmp_path / "run" / "summary.json").exists()
