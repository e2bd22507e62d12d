"""Random schedules of faults, and random teams for them, each by its seed alone."""

from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from agents.mission.mission import Mission
from agents.seeds import generator
from sim.campaign.faults import (
    AnyFault,
    Clock,
    Cut,
    DiskFull,
    Join,
    Kill,
    RouterDown,
    Schedule,
    Slow,
    Stop,
    Weather,
)
from sim.network.conditions import NetworkConditions

SLOWEST_S = 3.1  # the most that a message takes in any weather
REFUSED_S = 12.0  # further off than any clock that is corrected
CROWD_EVERY, CROWD = 100, 64  # of so many seeds, one has so many robots that join at once
CROWD_S = 6.0  # and no longer a mission: each of their seconds costs one of the processor
POINTS = {  # between which two actions a process may be killed
    "robot": (
        "before store",
        "after store",
        "after set",
        "before plan",
        "after plan",
        "before pose",
        "after pose",
    ),
    "fusion": ("before store", "after store", "before posterior", "after posterior", "before picture"),
}


class Stage(msgspec.Struct, frozen=True, kw_only=True):
    """Where faults may strike: from `begin` to `end`, among these processes."""

    begin: float
    end: float
    robots: tuple[str, ...]
    fusions: tuple[str, ...]
    others: tuple[str, ...]
    crowd: tuple[str, ...] = ()  # who all join at once, and is struck by nothing else

    @property
    def everyone(self) -> tuple[str, ...]:
        return self.robots + self.fusions + self.others


Draw = Callable[[Stage, np.random.Generator], Sequence[AnyFault]]


def stage(mission: Mission, *, begin: float, end: float, viewer: bool = True) -> Stage:
    """Of a mission's processes."""
    return Stage(
        begin=begin,
        end=end,
        robots=tuple(robot.id for robot in mission.robots if robot.id not in crowd_of(mission)),
        fusions=tuple(mission.fusions()),
        others=("watch",) if viewer else (),
        crowd=crowd_of(mission),
    )


def cast_of(mission: Mission, seed: int) -> Mission:
    """The team that a seed's faults strike: some have two or three fusions, some 64 more robots."""
    rng = generator(seed, "cast")
    if mission.fusion.replicas == 1:
        replicas = int(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
        mission = msgspec.structs.replace(
            mission, fusion=msgspec.structs.replace(mission.fusion, replicas=replicas)
        )
    return _crowded(mission) if seed % CROWD_EVERY == CROWD % CROWD_EVERY else mission


def crowd_of(mission: Mission) -> tuple[str, ...]:
    """The ids of the robots that `cast_of` added."""
    return tuple(robot.id for robot in mission.robots if robot.id.startswith("crowd"))


def _crowded(mission: Mission) -> Mission:
    """With 64 robots more, like the first, on a grid over the area; as it was if they do not fit."""
    side = round(CROWD**0.5) + 1
    low, high = np.array(mission.area.min[:2]), np.array(mission.area.max[:2])
    starts = [np.array(robot.start[:2]) for robot in mission.robots]
    places = low + (high - low) * (np.indices((side, side)).reshape(2, -1).T + 0.5) / side
    room = 1.5 * mission.settings.separation_m
    gaps = np.min([np.linalg.norm(places - start, axis=1) for start in starts], axis=0)
    places = places[gaps > room][:CROWD]
    if len(places) < CROWD or float((high - low).min()) / side < room:
        return mission
    first = mission.robots[0]
    more = [
        msgspec.structs.replace(first, id=f"crowd{i + 1}", start=[*place.tolist(), *first.start[2:]])
        for i, place in enumerate(places)
    ]
    # Each for itself: 64 that settle who does what in so little room take minutes of processor time.
    inset = 0.15 * (high - low)
    corners = {"low": (low + inset).tolist(), "high": (high - inset).tolist(), "points": [3, 3]}
    return msgspec.structs.replace(
        mission,
        robots=[*mission.robots, *more],
        planner={"kind": "maasi", "candidates": corners},
        duration_s=min(mission.duration_s, CROWD_S),
    )


def random_schedule(seed: int, where: Stage) -> Schedule:
    """One to four kinds of trouble; the weather of one seed in two is bad all the way."""
    rng = generator(seed, "faults")
    faults: list[AnyFault] = []
    if rng.random() < 0.5:
        faults.append(weather(where.begin, where.end, rng))
    if where.crowd:
        faults.append(Join(at=float(rng.uniform(where.begin, where.end)), who=where.crowd))
    draws = [_DRAWS[i] for i in rng.choice(len(_DRAWS), size=int(rng.integers(1, 5)), replace=False)]
    for draw in draws:
        faults += draw(where, rng)
    return Schedule(seed=seed, faults=tuple(sorted(faults, key=lambda f: f.at)), calm_at=where.end)


def weather(begin: float, end: float, rng: np.random.Generator) -> Weather:
    """Bad conditions of any kind."""
    kinds = rng.random(6) < 0.4
    conditions = NetworkConditions(
        delay_s=float(rng.uniform(0.002, 0.1)),
        jitter_s=float(rng.choice([0.001, 0.02, 0.1])),
        loss=float(rng.uniform(0.0, 0.6)) if kinds[0] else 0.0,
        burst=float(rng.uniform(2.0, 8.0)) if kinds[1] else 0.0,
        duplication=float(rng.uniform(0.0, 0.3)) if kinds[2] else 0.0,
        late=float(rng.uniform(0.0, 0.1)) if kinds[3] else 0.0,
        late_s=float(rng.uniform(0.5, SLOWEST_S - 1.1)),
        corruption=float(rng.uniform(0.0, 0.2)) if kinds[4] else 0.0,
        datagrams=bool(kinds[5]),
    )
    return Weather(at=begin, until=end, conditions=conditions)


def _span(where: Stage, rng: np.random.Generator, most: float) -> tuple[float, float]:
    begin = float(rng.uniform(where.begin, where.end - 1.0))
    return begin, min(where.end, begin + float(rng.uniform(0.5, most)))


def _group(names: Sequence[str], rng: np.random.Generator) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Two groups of names, none empty."""
    order = [names[i] for i in rng.permutation(len(names))]
    size = int(rng.integers(1, len(names)))
    return tuple(sorted(order[:size])), tuple(sorted(order[size:]))


def _partition(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    begin, end = _span(where, rng, 8.0)
    some, rest = _group(where.everyone, rng)
    return [Cut(at=begin, until=end, from_=some, to=rest, one_way=bool(rng.random() < 0.4))]


def _wandering(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    """A partition that runs through the team: every robot in turn loses all others."""
    begin = float(rng.uniform(where.begin, max(where.begin, where.end - 2.0)))
    step = (where.end - begin) / len(where.robots)
    return [
        Cut(
            at=begin + i * step,
            until=min(where.end, begin + (i + 1.3) * step),
            from_=(name,),
            to=tuple(other for other in where.everyone if other != name),
        )
        for i, name in enumerate(where.robots)
    ]


def _router(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    begin, end = _span(where, rng, 5.0)
    return [RouterDown(at=begin, until=end)]


def _dead_robot(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    at = float(rng.uniform(where.begin, where.end - 1.0))
    back = float(rng.uniform(0.5, where.end - at)) if rng.random() < 0.6 else None
    who = str(rng.choice(where.robots))
    point = str(rng.choice(POINTS["robot"])) if rng.random() < 0.4 else ""
    return [Kill(at=at, who=who, back_after=back, point=point)]


def _dead_fusion(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    at = float(rng.uniform(where.begin, where.end - 1.0))
    point = str(rng.choice(POINTS["fusion"])) if rng.random() < 0.5 else ""
    back = float(rng.uniform(0.2, min(6.0, where.end - at)))
    return [Kill(at=at, who=str(rng.choice(where.fusions)), back_after=back, point=point)]


def _stopped(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    begin, end = _span(where, rng, 6.0)
    return [Stop(at=begin, until=end, who=str(rng.choice(where.everyone)))]


def _slow(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    begin, end = _span(where, rng, 8.0)
    who = str(rng.choice(where.fusions + where.others))
    return [Slow(at=begin, until=end, who=who, every_s=float(rng.uniform(0.2, 2.0)))]


def _viewer(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    """Frozen or dead: nobody may notice."""
    if not where.others:
        return []
    begin, end = _span(where, rng, 8.0)
    if rng.random() < 0.5:
        return [Stop(at=begin, until=end, who=where.others[0])]
    return [Kill(at=begin, who=where.others[0])]


def _disk(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    begin, end = _span(where, rng, 4.0)
    return [DiskFull(at=begin, until=end, who=str(rng.choice(where.fusions)))]


def _clock(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    """A robot whose clock is off from the start, or set in mid-mission and read at its next start."""
    who = str(rng.choice(where.robots))
    offset, drift = float(rng.uniform(-5.0, 5.0)), float(rng.uniform(-200e-6, 200e-6))
    if rng.random() < 0.1:
        offset += float(np.copysign(REFUSED_S, offset))
    if rng.random() < 0.5:
        return [Clock(at=0.0, who=who, offset=offset, drift=drift)]
    at = float(rng.uniform(where.begin, max(where.begin, where.end - 2.0)))
    return [
        Clock(at=at, who=who, offset=offset, drift=drift),
        Kill(at=at + 0.1, who=who, back_after=1.0),
    ]


def _late(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    """Some of the robots come later, all at once."""
    if len(where.robots) < 2:
        return []
    some, _ = _group(where.robots, rng)
    return [Join(at=float(rng.uniform(where.begin, where.end)), who=some)]


def _no_fusion(where: Stage, rng: np.random.Generator) -> list[AnyFault]:
    """None at all for a while: the team starts before it, or it dies, maybe for good."""
    if rng.random() < 0.3:
        return [Join(at=float(rng.uniform(where.begin, where.end)), who=where.fusions)]
    at = float(rng.uniform(where.begin, 0.5 * (where.begin + where.end)))
    back = float(rng.uniform(0.5 * (where.end - at), where.end - at)) if rng.random() < 0.5 else None
    return [Kill(at=at, who=fusion, back_after=back) for fusion in where.fusions]


_DRAWS: tuple[Draw, ...] = (
    _partition,
    _wandering,
    _router,
    _dead_robot,
    _dead_fusion,
    _stopped,
    _slow,
    _viewer,
    _disk,
    _clock,
    _late,
    _no_fusion,
)
