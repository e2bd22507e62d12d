"""One seed of the fault campaign: a run under a random schedule, in virtual time, and what does not hold."""

from dataclasses import dataclass, field
from typing import Any

import msgspec

from agents.invariants import Report, RunHistory, check
from agents.invariants.sets import recovery_limit_s
from agents.mission.mission import Mission
from agents.team import Team
from sim.campaign.draws import SLOWEST_S, cast_of, random_schedule, stage
from sim.campaign.faults import Clock, Schedule
from sim.campaign.injector import Injector
from sim.engine.engine import Engine

BEGIN_S = 1.0  # before it, nothing goes wrong
TWICE_EVERY = 10  # every so many seeds the run is done twice: the log must be the same


@dataclass
class Trial:
    """What came of one seed."""

    seed: int
    schedule: Schedule
    report: Report
    log_hash: str
    summary: dict[str, Any] = field(default_factory=dict)
    history: RunHistory | None = None

    @property
    def failed(self) -> bool:
        return bool(self.report.violations)


def schedule_of(mission: Mission, seed: int) -> Schedule:
    """The seed's faults. The end of the mission is calm, for as long as a set may take to come."""
    mission = cast_of(mission, seed)
    calm = recovery_limit_s(mission, SLOWEST_S)
    end = max(BEGIN_S + 3.0, mission.duration_s - calm)
    return random_schedule(seed, stage(mission, begin=BEGIN_S, end=end))


def run(mission: Mission, schedule: Schedule, seed: int) -> tuple[Engine, RunHistory]:
    """One run under a schedule."""
    mission = msgspec.structs.replace(mission, seed=seed)
    injector = Injector(RunHistory(mission, seed, "virtual"), schedule)
    engine = Engine(
        Team.of(mission),
        seed,
        viewer=True,
        absent=schedule.absent,
        onlooker=injector,
        clocks=any(isinstance(fault, Clock) for fault in schedule.faults),
    )
    injector.begin(engine)
    engine.run()
    return engine, injector.finish()


def trial(mission: Mission, seed: int, *, keep: bool = False) -> Trial:
    """One seed of the campaign, checked. `keep` its history."""
    schedule, mission = schedule_of(mission, seed), cast_of(mission, seed)
    engine, history = run(mission, schedule, seed)
    report = check(history)
    if seed % TWICE_EVERY == 0:
        again, _ = run(mission, schedule, seed)
        report.counts["runs repeated"] += 1
        if again.log_hash != engine.log_hash:
            report.violate("determinism", 0.0, "the same seed gave another log")
    return Trial(
        seed, schedule, report, engine.log_hash, engine.scoreboard.summary(), history if keep else None
    )
