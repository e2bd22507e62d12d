"""What can go wrong in a simulated run, and random schedules of it, each by its seed alone."""

from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from agents.mission.mission import Mission
from agents.seeds import generator
from sim.network.conditions import NetworkConditions

CALM = NetworkConditions()
SLOWEST_S = 3.1  # the most that a message takes in any weather
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


class Fault(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Something that begins `at` a true time."""

    at: float


class Weather(Fault, frozen=True, kw_only=True):
    """Other network conditions, on all links, until a time."""

    until: float
    conditions: NetworkConditions


class Cut(Fault, frozen=True, kw_only=True):
    """Nothing gets from one group to the other, nor back unless it is one-way."""

    until: float
    from_: tuple[str, ...]
    to: tuple[str, ...]
    one_way: bool = False


class RouterDown(Fault, frozen=True, kw_only=True):
    """The router is dead or stopped: nobody reaches anybody."""

    until: float


class Kill(Fault, frozen=True, kw_only=True):
    """SIGKILL; started again `back_after` seconds later, if at all. `point`: at the next one from `at` on."""

    who: str
    back_after: float | None = None
    point: str = ""


class Stop(Fault, frozen=True, kw_only=True):
    """SIGSTOP, and SIGCONT at `until`."""

    until: float
    who: str


class Slow(Fault, frozen=True, kw_only=True):
    """A process that looks at what has come only so often."""

    until: float
    who: str
    every_s: float


class DiskFull(Fault, frozen=True, kw_only=True):
    """A fusion's disk takes nothing; it is started again every second, until there is room."""

    until: float
    who: str


class Clock(Fault, frozen=True, kw_only=True):
    """A computer's time of day is off from now on, and runs apart; its processes notice when they start."""

    who: str
    offset: float
    drift: float = 0.0


class Join(Fault, frozen=True, kw_only=True):
    """Processes that were absent start, all at once."""

    who: tuple[str, ...]


AnyFault = Weather | Cut | RouterDown | Kill | Stop | Slow | DiskFull | Clock | Join


class Schedule(msgspec.Struct, frozen=True, kw_only=True):
    """All that goes wrong in one run, in the order of time. From `calm_at` on nothing does."""

    seed: int
    faults: tuple[AnyFault, ...]
    calm_at: float

    @property
    def absent(self) -> frozenset[str]:
        """Who is not there at the start."""
        return frozenset(name for fault in self.faults if isinstance(fault, Join) for name in fault.who)

    def __str__(self) -> str:
        lines = [f"{fault.at:7.2f} s  {describe(fault)}" for fault in self.faults]
        return "\n".join([*lines, f"{self.calm_at:7.2f} s  calm"])


def describe(fault: AnyFault) -> str:
    """In words."""
    fields = {name: getattr(fault, name) for name in fault.__struct_fields__ if name != "at"}
    if isinstance(fault, Weather):
        usual = msgspec.to_builtins(CALM)
        other = msgspec.to_builtins(fault.conditions)
        fields = {"until": fault.until} | {k: v for k, v in other.items() if v != usual[k]}
    shown = ", ".join(f"{name.strip('_')} {_show(value)}" for name, value in fields.items() if value != "")
    return f"{type(fault).__name__.lower()}: {shown}"


def _show(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return "+".join(map(str, value)) if isinstance(value, tuple) else str(value)


class Stage(msgspec.Struct, frozen=True, kw_only=True):
    """Where faults may strike: from `begin` to `end`, among these processes."""

    begin: float
    end: float
    robots: tuple[str, ...]
    fusions: tuple[str, ...]
    others: tuple[str, ...]

    @property
    def everyone(self) -> tuple[str, ...]:
        return self.robots + self.fusions + self.others


Draw = Callable[[Stage, np.random.Generator], Sequence[AnyFault]]


def stage(mission: Mission, *, begin: float, end: float, viewer: bool = True) -> Stage:
    """Of a mission's processes."""
    return Stage(
        begin=begin,
        end=end,
        robots=tuple(robot.id for robot in mission.robots),
        fusions=tuple(mission.fusions()),
        others=("watch",) if viewer else (),
    )


def random_schedule(seed: int, where: Stage) -> Schedule:
    """One to four kinds of trouble; the weather of one seed in two is bad all the way."""
    rng = generator(seed, "faults")
    faults: list[AnyFault] = []
    if rng.random() < 0.5:
        faults.append(weather(where.begin, where.end, rng))
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
    begin = float(rng.uniform(where.begin, where.end - 2.0))
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
    offset, drift = float(rng.uniform(-5.0, 5.0)), float(rng.normal(0.0, 50e-6))
    if rng.random() < 0.5:
        return [Clock(at=0.0, who=who, offset=offset, drift=drift)]
    at = float(rng.uniform(where.begin, where.end - 2.0))
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
)
