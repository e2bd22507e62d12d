"""What can go wrong in a simulated run, and schedules of it (random ones: sim.campaign.draws)."""

import msgspec

from sim.network.conditions import NetworkConditions

CALM = NetworkConditions()


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
