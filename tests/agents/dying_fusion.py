"""A fusion that is killed with SIGKILL at named points, one life after the other, on one ledger.

python -m tests.agents.dying_fusion LEDGER STORY POINT:COUNT ... prints, as JSON, what the last life comes to,
which nothing kills. Lives are forked, so that all of them together cost one start of Python.
"""

import hashlib
import json
import os
import pickle
import signal
import sqlite3
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from agents.fusion import estimate
from agents.ledger.ledger import Ledger
from agents.machine import Action, Heard, Keep, Publish, Store
from agents.wire.messages import LedgerEntry, PosteriorMessage
from agents.wire.topics import SET
from tests.agents.ledger_story import Stage, team

MARK_EVERY = 16  # so that there are checkpoints to die at

POINTS = (
    "before store",
    "within store",  # after the rows were written, before the commit
    "after store",
    "after posterior",
    "before checkpoint",
    "within checkpoint",
    "after checkpoint",
    "while settling",  # late sets are stored, and on the way to their places
)


def disturbed(entries: Sequence[LedgerEntry]) -> list[LedgerEntry]:
    """Every sixth of r2's sets comes 10 s late: beyond the rollback window."""
    return sorted(entries, key=lambda e: e.time + 10.0 * (e.sender == "r2" and e.sequence % 6 == 0))


class Dying(Stage):
    """Counts how often it comes to its point, and dies there."""

    point, count = "", 0

    def reach(self, point: str) -> None:
        if point == self.point:
            self.count -= 1
            if self.count == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    def step(self, now: float, *events: Any) -> list[Action]:
        if self.fusion.estimate.settling:
            self.reach("while settling")
        actions = self.fusion.step(now, events)
        for action in actions:
            if isinstance(action, Store):
                self._durably("store", lambda a=action: self.ledger.store(a.entries, a.expired, a.revived))  # type: ignore[misc]
            elif isinstance(action, Keep):
                self._durably("checkpoint", lambda a=action: self.ledger.keep(a.checkpoint, a.kept))  # type: ignore[misc]
            elif isinstance(action, Publish) and isinstance(action.message, PosteriorMessage):
                self.reach("after posterior")
        return actions

    def _durably(self, what: str, act: Callable[[], None]) -> None:
        self.reach(f"before {what}")
        if self.point == f"within {what}":
            self.ledger._db = _AtCommit(self.ledger._db, lambda: self.reach(f"within {what}"))  # type: ignore[assignment]
        act()
        if isinstance(self.ledger._db, _AtCommit):
            self.ledger._db = self.ledger._db.real
        self.reach(f"after {what}")


class _AtCommit:
    """A connection that is watched."""

    def __init__(self, real: sqlite3.Connection, reach: Callable[[], None]) -> None:
        self.real = real
        self._reach = reach

    def __getattr__(self, name: str) -> Any:
        return getattr(self.real, name)

    def execute(self, statement: str, *values: Any) -> Any:
        if statement == "COMMIT":
            self._reach()
        return self.real.execute(statement, *values)


def live(path: Path, entries: Sequence[LedgerEntry], point: str, count: int) -> dict[str, Any]:
    """One life: robots offer again all that no watermark covers, then what is new."""
    with Ledger(path) as ledger:
        stage = Dying(team(), ledger)
        stage.point, stage.count = point, count
        restored = stage.fusion.estimate.sets
        reapplied = restored - max((c.entries for c in ledger.checkpoints()), default=0)
        for entry in disturbed(entries):
            if not stage.fusion.estimate.holds(entry):
                stage.step(1e3, Heard(SET, entry))
        stage.settle()
        numbers = [(r.robot, r.boot, r.sequence) for r in ledger.rows()]
        return {
            "restored": restored,
            "after_checkpoint": reapplied,
            "sets": stage.fusion.estimate.sets,
            "stored": len(numbers),
            "unique": len(set(numbers)),
            "posterior": hashlib.sha256(stage.posterior()).hexdigest(),
        }


def main() -> None:
    estimate.MARK_EVERY = MARK_EVERY
    path, entries = Path(sys.argv[1]), pickle.loads(Path(sys.argv[2]).read_bytes())
    Stage(team()).hear(entries[:12])  # loads the kernels, for all lives
    deaths = []
    for word in sys.argv[3:]:
        point, _, count = word.rpartition(":")
        child = os.fork()
        if child == 0:
            live(path, entries, point, int(count))
            os._exit(0)
        _, status = os.waitpid(child, 0)
        deaths.append(-os.waitstatus_to_exitcode(status))
    print(json.dumps({"deaths": deaths, **live(path, entries, "", 0)}))


if __name__ == "__main__":
    main()
