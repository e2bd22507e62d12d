"""A small team's measurement sets, and fusions with ledgers that take them in whatever order."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from agents.fusion.fusion import Fusion, FusionSetup
from agents.ledger.ledger import Ledger
from agents.machine import Action, Event, Heard, Keep, Publish, Store
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.team import Team
from agents.wire import codec
from agents.wire.messages import LedgerEntry, Message
from agents.wire.topics import SET
from sim.engine.engine import Engine
from tests.agents.swarm.test_swarm import write_mission

SEED = 3
FINGERPRINT = "one"


@cache
def team(duration: float = 40.0, **fusion: Any) -> Team:
    with TemporaryDirectory() as directory:
        mission = load(write_mission(Path(directory), duration=duration))
    mission = msgspec.structs.replace(
        mission,
        stop_when_all_found=False,
        filter={**mission.filter, "particles": 200},
        fusion=msgspec.structs.replace(mission.fusion, **fusion),
    )
    return Team.of(mission)


@cache
def story(duration: float = 40.0) -> tuple[LedgerEntry, ...]:
    """What three robots measured, in the order of capture."""
    kept: list[LedgerEntry] = []

    def record(topic: object, message: Message) -> None:
        if topic is SET and isinstance(message, LedgerEntry):
            kept.append(message)

    Engine(team(duration), SEED, record=record).run()
    unique = {(m.sender, m.boot, m.sequence): m for m in kept}
    return tuple(sorted(unique.values(), key=lambda m: (m.time, m.sender, m.boot, m.sequence)))


@dataclass
class Stage:
    """A fusion with its ledger; `die` and `begin` are a SIGKILL and a restart."""

    team: Team
    ledger: Ledger = field(default_factory=Ledger)
    name: str = "fusion"
    boots: int = 0

    def __post_init__(self) -> None:
        self.said: list[Message] = []
        self.begin()

    @property
    def mission(self) -> Mission:
        return self.team.mission

    def begin(self) -> None:
        setup = FusionSetup(
            self.mission,
            self.name,
            f"f{self.boots}",
            self.team.search(),
            self.team.sensor_models,
            self.ledger,
            FINGERPRINT,
        )
        self.boots += 1
        self.fusion = Fusion(setup, SEED)
        self.fusion.restore()

    def step(self, now: float, *events: Event) -> list[Action]:
        actions = self.fusion.step(now, events)
        for action in actions:
            if isinstance(action, Store):
                self.ledger.store(action.entries, action.expired, action.revived)
            elif isinstance(action, Keep):
                self.ledger.keep(action.checkpoint, action.kept)
            elif isinstance(action, Publish):
                self.said.append(action.message)
        return actions

    def hear(self, entries: Iterable[LedgerEntry], now: float = 1e3) -> None:
        """One step each."""
        for entry in entries:
            self.step(now, Heard(SET, entry))

    def hear_together(self, entries: Sequence[LedgerEntry], now: float = 1e3) -> None:
        self.step(now, *(Heard(SET, entry) for entry in entries))

    def settle(self, now: float = 1e3) -> None:
        """Until there is nothing more to do."""
        for _ in range(10_000):
            if not self.fusion.estimate.settling:
                return
            self.step(now)
        raise AssertionError("it does not come to an end")

    def posterior(self) -> bytes:
        """All bits of the posterior but its header and its watermark, which tells of recent boots."""
        message = self.fusion._posterior()
        plain = msgspec.structs.replace(message, sender="any", boot="any", sequence=0, watermark={})
        return codec.encode(plain)

    def holds(self) -> dict[str, Any]:
        return self.fusion.estimate.applied.all()
