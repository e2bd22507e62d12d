"""Plugins that do nothing, so that missions can be tested without any filter, planner or simulator."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from agents import plugins
from agents.errors import DataError, MissionError
from estimator.arrays import Count, Fraction, Positive
from estimator.filter import Area


class Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table in which an unknown key is an error."""


class World:
    class Config(Strict, frozen=True, kw_only=True):
        targets: Count
        data: Path | None = None

    @staticmethod
    def world(config: Any, area: Area, seed: int) -> Any:
        if config.data is not None and not config.data.is_dir():
            raise DataError(f"{config.data} is no directory")
        return SimpleNamespace(config=config, area=area, seed=seed)


class Filter:
    class Config(Strict, frozen=True, kw_only=True):
        particles: Count = 1000
        birth: Positive = 0.01

    def __init__(self, config: Config) -> None:
        self.config = config


class Candidates(Strict, frozen=True, kw_only=True):
    low: list[float]
    high: list[float]
    points: list[Count]

    def __post_init__(self) -> None:
        if not len(self.low) == len(self.high) == len(self.points):
            raise ValueError("low, high and points: expected one number per axis each")


class Planner:
    class Config(Strict, frozen=True, kw_only=True):
        alpha: Positive = 0.5
        candidates: Candidates

    def __init__(self, config: Config, setup: Any) -> None:
        self.config, self.setup = config, setup


class Vehicle:
    class Config(Strict, frozen=True, kw_only=True):
        speed_m_s: Positive = 8.0
        acceleration_m_s2: Positive = 4.0

    @staticmethod
    def model(config: Any, area: Area) -> Any:
        return ("vehicle", config)

    @staticmethod
    def device(config: Any, context: Any) -> Any:
        return ("vehicle", config, context)


class Sensor:
    class Config(Strict, frozen=True, kw_only=True):
        period_s: Positive = 1.0
        gain: Fraction = 1.0
        reach_m: list[Positive]

    @staticmethod
    def model(config: Any, area: Area) -> Any:
        if len(config.reach_m) != area.dimension:
            raise ValueError(f"reach_m: {len(config.reach_m)} values, expected {area.dimension}")
        return ("sensor", config)

    @staticmethod
    def device(config: Any, context: Any) -> Any:
        return ("sensor", config, context)


class Recorded:
    class Config(Strict, frozen=True, kw_only=True):
        data: Path

        def __post_init__(self) -> None:
            if self.data.suffix == ".bag":
                raise ValueError("a directory of text files, not a bag")

    model = staticmethod(Vehicle.model)
    device = staticmethod(Vehicle.device)


KINDS: dict[str, dict[str, Any]] = {
    "worlds": {"uniform": World},
    "filters": {"smc_phd": Filter},
    "planners": {"maasi": Planner},
    "vehicles": {"quadrotor": Vehicle, "mrclam": Recorded, "broken": None},
    "sensors": {"range_bearing": Sensor},
    "transports": {"zenoh": object},
}


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let these be all the plugins there are."""

    def load(group: str, kind: str) -> Any:
        if kind == "broken":
            raise ImportError("no module named 'casadi'")
        if kind not in KINDS[group]:
            raise MissionError(f"no {group} kind {kind!r}")
        return KINDS[group][kind]

    monkeypatch.setattr(plugins, "kinds", lambda group: tuple(sorted(KINDS[group])))
    monkeypatch.setattr(plugins, "load", load)


MISSION = """
name = "test"
seed = 7

[area]
min = [0, 0]
max = [200, 100]

[world]
kind = "uniform"
targets = 3

[filter]
kind = "smc_phd"

[planner]
kind = "maasi"
candidates = { low = [20, 20], high = [180, 80], points = [5, 5] }

[[robots]]
id = "r1"
start = [5, 5]
vehicle = { kind = "quadrotor" }
sensor = { kind = "range_bearing", reach_m = [20, 20] }

[[robots]]
id = "r2"
start = [195, 95, 10, 1.5]
vehicle = { kind = "quadrotor", speed_m_s = 3 }
sensor = { kind = "range_bearing", reach_m = [20, 20], gain = 0.9 }
"""
