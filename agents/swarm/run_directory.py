"""The directory that keeps what a run was and what came of it."""

import json
import math
from datetime import datetime
from pathlib import Path
from typing import Any

from agents.errors import StorageError
from agents.mission.mission import Mission
from agents.mission.mission_file import dumps


class RunDirectory:
    """mission.toml, summary.json, ledgers, outboxes, view.rrd and a log file per process."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"RunDirectory({self.path})"

    @classmethod
    def create(cls, mission: Mission, out: Path | None) -> "RunDirectory":
        """Make the directory: `out`, or a new one under runs/ of the current directory.

        Raises:
            StorageError: if it cannot be written, or holds another run.
        """
        path = out or _fresh(Path("runs"), mission.name)
        try:
            path.mkdir(parents=True, exist_ok=True)
            directory = cls(path)
            if directory.ledger.exists():
                raise StorageError(f"{path} holds another run: choose a new directory with --out")
            directory.mission.write_text(dumps(mission))
        except OSError as error:
            raise StorageError(
                f"cannot write the run directory {path}: {error.strerror}; free some disk space or choose "
                "another directory with --out"
            ) from error
        return directory

    @property
    def mission(self) -> Path:
        return self.path / "mission.toml"

    @property
    def ledger(self) -> Path:
        return self.ledger_of("fusion")

    def ledger_of(self, fusion: str) -> Path:
        """Each fusion has a ledger of its own."""
        return self.path / ("ledger.sqlite" if fusion == "fusion" else f"ledger-{fusion}.sqlite")

    def outbox_of(self, robot: str) -> Path:
        """Where a robot keeps the sets that no fusion has."""
        return self.path / f"{robot}.outbox"

    @property
    def view(self) -> Path:
        return self.path / "view.rrd"

    @property
    def summary(self) -> Path:
        return self.path / "summary.json"

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Raises StorageError if the disk does not take it."""
        write_json(self.summary, summary)


def write_json(path: Path, value: Any) -> None:
    """Raises StorageError if the disk does not take it."""
    try:
        path.write_text(json.dumps(finite(value), indent=2) + "\n")
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror}") from error


def finite(value: Any) -> Any:
    """The same value without NaN and infinity: null, the only word JSON has for them."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value


def _fresh(parent: Path, name: str) -> Path:
    stem = f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
    path, number = parent / stem, 1
    while path.exists():
        number += 1
        path = parent / f"{stem}-{number}"
    return path
