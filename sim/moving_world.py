"""A world whose targets move: straight on, turned back at the area's border or gone beyond it."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from agents.devices import World
from agents.errors import MissionError
from agents.seeds import generator
from estimator.arrays import FloatArray, NonNegative
from estimator.filter import Area


@dataclass
class Walk:
    """A random walk of each target, a step a second, straight in between; as long as it was asked for."""

    rng: np.random.Generator
    drift: float  # standard deviation of a step, per axis, m
    shape: tuple[int, int]  # (d, n)
    _places: list[FloatArray] = field(default_factory=list)  # after each second

    def at(self, time: float) -> FloatArray:
        """(d, n) metres from where the targets would be without."""
        second = max(0, int(time))
        while len(self._places) < second + 2:
            last = self._places[-1] if self._places else np.zeros(self.shape)
            step = self.drift * self.rng.standard_normal(self.shape)
            self._places.append(last + step if self._places else last)
        before, after = self._places[second], self._places[second + 1]
        return np.asarray(before + (time - second) * (after - before))


@dataclass(frozen=True)
class MovingWorld:
    """Targets with constant velocities, and random walks beside. Where they are depends on time alone."""

    starts: FloatArray  # (d, n) m at time 0
    velocities: FloatArray  # (d, n) m/s
    area: Area
    reflecting: bool  # else targets leave, and come back never
    walk: "Walk | None" = None

    def targets(self, time: float) -> FloatArray:
        """True target positions (d, n), or (d, k) of the k that have not left the area."""
        places = self.starts + time * self.velocities
        if self.walk is not None:
            places = places + self.walk.at(time)
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
        drift: NonNegative = 0.0  # random walk beside: standard deviation after a second, m / s^(1/2)
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
        starts = np.ascontiguousarray(np.concatenate([starts, more], axis=1))
        velocities = np.ascontiguousarray(np.concatenate([given, directions], axis=1))
        walk = None
        if config.drift > 0:
            walk = Walk(generator(seed, "world", "walk"), config.drift, (d, starts.shape[1]))
        return MovingWorld(starts, velocities, area, config.border == "reflect", walk)
