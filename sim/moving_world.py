"""A world whose targets move: straight on, turned back at the area's border or gone beyond it."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from agents.devices import World
from agents.errors import MissionError
from agents.seeds import generator
from estimator.arrays import FloatArray, NonNegative
from estimator.filter import Area


@dataclass(frozen=True)
class MovingWorld:
    """Targets with constant velocities. Where they are is a function of time alone."""

    starts: FloatArray  # (d, n) m at time 0
    velocities: FloatArray  # (d, n) m/s
    area: Area
    reflecting: bool  # else targets leave, and come back never

    def targets(self, time: float) -> FloatArray:
        """True target positions (d, n), or (d, k) of the k that have not left the area."""
        places = self.starts + time * self.velocities
        low, high = self.area.low[:, None], self.area.high[:, None]
        if not self.reflecting:
            return np.ascontiguousarray(places[:, ((places >= low) & (places <= high)).all(axis=0)])
        # A target between two mirrors runs through their images: there and back is twice the side.
        side = high - low
        folded = np.mod(places - low, 2.0 * side)
        return np.asarray(low + np.minimum(folded, 2.0 * side - folded))


class MovingWorldKind:
    """`kind = "moving"`: given targets, and random ones beside them, each with a constant velocity."""

    class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
        starts: list[list[float]] = []  # m
        velocities: list[list[float]] = []  # m/s, one for each start
        targets: Annotated[int, Meta(ge=0, le=100_000)] = 0  # random ones, in addition
        speed_m_s: NonNegative = 1.0  # of the random ones, in random directions
        border: Literal["reflect", "leave"] = "reflect"

    @staticmethod
    def world(config: Any, area: Area, seed: int) -> World:
        """Raises MissionError if starts and velocities do not fit each other or the area."""
        d = area.dimension
        if len(config.velocities) != len(config.starts):
            raise MissionError(
                f"world.velocities: found {len(config.velocities)}, needed is one for each of the "
                f"{len(config.starts)} starts"
            )
        for name in ("starts", "velocities"):
            for i, vector in enumerate(getattr(config, name)):
                if len(vector) != d or not np.isfinite(vector).all():
                    raise MissionError(f"world.{name}[{i}]: found {vector}, allowed are {d} finite numbers")
        starts = np.array(config.starts, dtype=float).reshape(-1, d).T
        for i in range(starts.shape[1]):
            if not ((starts[:, i] >= area.low) & (starts[:, i] <= area.high)).all():
                raise MissionError(f"world.starts[{i}]: {config.starts[i]} is outside the area")
        rng = generator(seed, "world", "targets")
        low, high = area.low[:, None], area.high[:, None]
        more = rng.uniform(low, high, (d, config.targets))
        directions = rng.standard_normal((d, config.targets))
        directions *= config.speed_m_s / np.linalg.norm(directions, axis=0)
        given = np.array(config.velocities, dtype=float).reshape(-1, d).T
        return MovingWorld(
            np.ascontiguousarray(np.concatenate([starts, more], axis=1)),
            np.ascontiguousarray(np.concatenate([given, directions], axis=1)),
            area,
            config.border == "reflect",
        )
