"""Worlds for simulation: where the targets are, as a function of the mission's seed."""

from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from agents.devices import World
from agents.errors import MissionError
from agents.seeds import generator
from estimator.arrays import FloatArray, NonNegative
from estimator.filter import Area

ATTEMPTS = 10_000


@dataclass(frozen=True)
class StaticWorld:
    """Targets that stay where they are."""

    positions: FloatArray  # (d, n)

    def targets(self, time: float) -> FloatArray:
        """True target positions (d, n)."""
        return self.positions


class UniformWorldKind:
    """`kind = "uniform"`: a number of targets anywhere in the area, with a map anywhere in its free space."""

    class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
        targets: Annotated[int, Meta(ge=0, le=100_000)]
        spacing_m: NonNegative = 0.0  # between any two targets
        margin_m: NonNegative = 0.0  # from the area's edge

    @staticmethod
    def world(config: Any, area: Area, seed: int) -> World:
        """Raises MissionError if so many targets do not fit with that spacing, into free space of the map."""
        rng = generator(seed, "world", "targets")
        low, high = area.low + config.margin_m, area.high - config.margin_m
        if (high <= low).any():
            raise MissionError(f"world.margin_m: {config.margin_m} leaves no area")
        points: list[FloatArray] = []
        for _ in range(ATTEMPTS + 10 * config.targets):
            if len(points) == config.targets:
                break
            point = rng.uniform(low, high)
            if not area.is_free(point[:, None])[0]:
                continue
            if all(np.linalg.norm(point - other) >= config.spacing_m for other in points):
                points.append(point)
        else:
            raise MissionError(
                f"world: {config.targets} targets {config.spacing_m} m apart do not fit into the area; "
                "take fewer targets or a smaller spacing_m"
            )
        return StaticWorld(np.array(points).reshape(-1, area.dimension).T.copy())


class FixedWorldKind:
    """`kind = "fixed"`: targets at given places."""

    class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
        positions: list[list[float]]

    @staticmethod
    def world(config: Any, area: Area, seed: int) -> World:
        """Raises MissionError if a position has another dimension than the area, or lies in no free space."""
        for i, position in enumerate(config.positions):
            if len(position) != area.dimension:
                raise MissionError(
                    f"world.positions[{i}]: found {position}, allowed are {area.dimension} numbers"
                )
            if not area.is_free(np.array(position, dtype=np.float64)[:, None])[0]:
                raise MissionError(
                    f"world.positions[{i}]: found {position}, allowed are places in free space of the map "
                    "that a way leads to"
                )
        return StaticWorld(np.array(config.positions, dtype=float).reshape(-1, area.dimension).T.copy())
