"""Hand-made histories of a team of two robots and a fusion, to be spoilt in one place."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import msgspec
import numpy as np

from agents.fusion.watermark import Applied
from agents.invariants import Report, RunHistory
from agents.invariants.connections import Truth
from agents.invariants.history import Places, Said
from agents.invariants.replay import replayed
from agents.mission.mission import Mission
from agents.mission.mission_file import load
from agents.team import Team
from agents.wire.messages import (
    BidMessage,
    LedgerEntry,
    MeasurementSetMessage,
    Message,
    PoseMessage,
    PosteriorMessage,
)

END = 30.0


@cache
def mission() -> Mission:
    return msgspec.structs.replace(load("campaign"), duration_s=END)


@cache
def team() -> Team:
    return Team.of(mission())


def header(sender: str, sequence: int, time: float, boot: str = "b0") -> dict[str, Any]:
    return {
        "team": mission().team,
        "sender": sender,
        "boot": boot,
        "sequence": sequence,
        "time": time,
    }


def set_of(robot: str, sequence: int, time: float, boot: str = "b0") -> MeasurementSetMessage:
    rng = np.random.default_rng([sequence, int(1000 * time)])
    pose = np.array([50.0 + time, 50.0, 5.0, 0.0])
    measurements = np.column_stack([rng.uniform(3, 12, 1), rng.uniform(-3, 3, 1)])
    return MeasurementSetMessage(**header(robot, sequence, time, boot), pose=pose, measurements=measurements)


def pose_of(robot: str, sequence: int, time: float) -> PoseMessage:
    return PoseMessage(
        **header(robot, sequence, time), pose=np.zeros(4), velocity=np.zeros(3), state="moving", travelled=0.0
    )


def bid_of(robot: str, sequence: int, time: float, owners: dict[str, str]) -> BidMessage:
    return BidMessage(
        **header(robot, sequence, time),
        said=time,
        tasks=sorted(owners),
        places=np.zeros((len(owners), 2)),
        path=[task for task, owner in owners.items() if owner == robot],
        winning_bids=dict.fromkeys(owners, 1.0),
        winning_agents=owners,
        timestamps={},
        digests={},
    )


def posterior_of(entries: Sequence[LedgerEntry], sequence: int, boot: str = "b0") -> PosteriorMessage:
    """Made by a filter of these entries in order, as the fusion's."""
    in_order = sorted(entries, key=lambda e: (e.time, e.sender, e.boot, e.sequence))
    made = replayed(team(), mission().seed, in_order)
    return msgspec.structs.replace(made, sender="fusion", boot=boot, sequence=sequence)


def told(
    entries: Sequence[LedgerEntry], sequence: int, boot: str = "b0", applied: int | None = None
) -> PosteriorMessage:
    """Its watermark is of these entries; nobody looks at its estimate."""
    known = Applied()
    for entry in entries:
        known.add(entry)
    return msgspec.structs.replace(
        posterior_of((set_of("r1", 0, 1.0),), sequence, boot),
        watermark=known.watermarks(),
        applied=len(entries) if applied is None else applied,
    )


class Story:
    """A run of END seconds in which everything was as it should be, so far."""

    def __init__(self, robots: Sequence[str] = ("r1", "r2"), driver: str = "virtual") -> None:
        self.history = RunHistory(mission(), mission().seed, driver)
        for who, role in [("fusion", "fusion"), *((robot, "robot") for robot in robots)]:
            self.history.tell(0.0, "up", who, role=role, boot="b0")

    def say(self, at: float, topic: str, message: Message) -> None:
        self.history.said.append(Said(at, topic, message))

    def places(self, at: float, **robots: tuple[float, float, float]) -> None:
        self.history.places.append(Places(at, robots))

    def check(self, invariant: Any) -> Report:
        history = self.history
        history.tell(END, "end")
        for some in (history.said, history.facts):
            some.sort(key=lambda item: item.at)
        report = Report()
        invariant(history, Truth(history), report)
        return report
