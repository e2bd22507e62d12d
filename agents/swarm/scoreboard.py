"""The scoreboard: what a run came to, from what the team said and what was true. The same in both drivers."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from agents.allocation.ownership import Ownership
from agents.devices import World
from agents.health.histogram import Histogram
from agents.machine import Heard
from agents.mission.mission import Mission
from agents.swarm.shown import Shown
from agents.wire.messages import (
    BidMessage,
    EstimateMessage,
    HealthMessage,
    MeasurementSetMessage,
    PoseMessage,
    PosteriorMessage,
)
from estimator.arrays import FloatArray
from estimator.metrics.gospa import gospa, matched

SILENT_S = 2.0
COUNTS = ("published", "received", "rejected", "lost", "duplicate", "late")


@dataclass
class Scoreboard:
    """Grows by `hear`; `summary()` is what summary.json holds."""

    mission: Mission
    seed: int
    driver: str  # "processes" or "virtual"
    world: World
    _posterior: EstimateMessage | None = None  # or, with no fusion, the fullest belief of a robot
    _poses: dict[str, PoseMessage] = field(default_factory=dict)
    _travelled: dict[str, dict[str, float]] = field(default_factory=dict)  # robot -> boot -> metres
    _health: dict[tuple[str, str], HealthMessage] = field(default_factory=dict)  # (sender, boot)
    _sets: set[tuple[str, str, int]] = field(default_factory=set)
    _separation: float = float("inf")
    _rows: dict[str, int] = field(default_factory=dict)  # robot -> row of the next
    _seen: FloatArray = field(default_factory=lambda: np.zeros((0, 7)))  # time, position, velocity
    _all_found_at: float | None = None
    _applied_at_all_found: int | None = None
    _curve: list[tuple[float, int, int, float, FloatArray]] = field(default_factory=list)
    _compared: tuple[FloatArray, FloatArray] | None = None  # truth and found targets last matched
    _matches: int = 0
    _present: int = 0  # true targets at the newest posterior's time: some may have left
    _labels: dict[int, int] = field(default_factory=dict)  # true target -> label of its found target
    _label_changes: int = 0
    tasks: Ownership = field(default_factory=Ownership)
    _now: float = 0.0

    def __post_init__(self) -> None:
        self._shown = Shown(self.mission.fusion.alone_after_s)

    def hear(self, heard: Heard, now: float) -> None:
        """Take in one message, whatever its topic."""
        message = heard.message
        self._now = max(self._now, now)
        if isinstance(message, BidMessage):
            self.tasks.hear(message, now)
        elif isinstance(message, EstimateMessage):
            self._hear_estimate(message, now)
        elif isinstance(message, PoseMessage):
            self._hear_pose(message)
        elif isinstance(message, MeasurementSetMessage):
            self._sets.add((message.sender, message.boot, message.sequence))
        elif isinstance(message, HealthMessage):
            self._health[message.sender, message.boot] = message

    @property
    def all_found(self) -> bool:
        """Whether every true target is matched by a found one, as far as the newest posterior knows."""
        return self._all_found_at is not None

    @property
    def targets_total(self) -> int:
        return int(self.world.targets(0.0).shape[1])

    @property
    def targets_found(self) -> int:
        """True targets that a found target matches."""
        return self._matches

    @property
    def expected_cardinality(self) -> float:
        return self._posterior.expected_cardinality if self._posterior else 0.0

    @property
    def measurement_sets(self) -> int:
        return len(self._sets)

    def _hear_estimate(self, message: EstimateMessage, now: float) -> None:
        if not self._shown.hear(message, now):
            return  # a replica that is behind
        self._posterior = message
        self._compare(self.world.targets(message.time), message)
        self._curve.append(
            (message.time, message.applied, self._matches, message.expected_cardinality, message.found)
        )
        if self._matches < self._present or not self._present:
            self._all_found_at = None  # a late set may take a finding back
        elif self._all_found_at is None:
            self._all_found_at = message.time
            self._applied_at_all_found = message.applied

    def _compare(self, truth: FloatArray, message: EstimateMessage) -> None:
        """Match found targets with true ones, as these were when the newest applied set was taken."""
        now = (truth, message.found)
        if self._compared is not None and all(map(np.array_equal, self._compared, now)):
            return
        self._compared, self._present = now, int(truth.shape[1])
        pairs = matched(truth, message.found, self.mission.match_m)
        self._matches = len(pairs)
        labels = message.found_labels.tolist()
        for i, j in pairs:
            known = self._labels.setdefault(i, labels[j])
            if known in labels:  # beside another target either may match: its own is near enough
                away = np.linalg.norm(message.found[:, labels.index(known)] - truth[:, i])
                if away <= self.mission.match_m:
                    continue
            self._label_changes += known != labels[j]
            self._labels[i] = labels[j]

    def _hear_pose(self, message: PoseMessage) -> None:
        self._travelled.setdefault(message.sender, {})[message.boot] = message.travelled
        known = self._poses.get(message.sender)
        if known is not None and known.boot == message.boot and known.time > message.time:
            return
        self._poses[message.sender] = message
        self._pass(message)

    def _pass(self, message: PoseMessage) -> None:
        """How near it is to the others, carried forward to its time; in one go, there may be a thousand."""
        row = self._rows.setdefault(message.sender, len(self._rows))
        if row == len(self._seen):
            self._seen = np.vstack([self._seen, np.full((max(16, row), 7), -np.inf)])
        seen = self._seen[: len(self._rows)]
        ages = message.time - seen[:, 0]
        near = ages < SILENT_S  # the silent may be anywhere
        near[row] = False
        self._seen[row] = [message.time, *message.pose[:3], *message.velocity]
        if near.any():
            there = seen[near, 1:4] + ages[near, None] * seen[near, 4:7]
            gaps = np.linalg.norm(there - message.pose[:3], axis=1)
            self._separation = min(self._separation, float(gaps.min()))

    def _histogram(self, name: str) -> Histogram:
        total = Histogram()
        for message in self._health.values():
            if name in message.histograms:
                total = total.merge(Histogram.of(message.histograms[name]))
        return total

    def _messages(self) -> dict[str, int]:
        total: Counter[str] = Counter()
        for message in self._health.values():
            total.update({key: message.counters.get(key, 0) for key in COUNTS})
            for key, value in message.counters.items():
                if key.startswith("rejected."):
                    total[key] += value
        applied = self._posterior.applied if self._posterior else 0
        expired = self._posterior.expired if isinstance(self._posterior, PosteriorMessage) else 0
        late: Counter[str] = Counter()  # by fusion: each of several has the same sets
        for message in self._health.values():
            late[message.sender] += message.counters.get("late_sets", 0)
        counts = {key: total[key] for key in COUNTS}
        counts["late"] = max(late.values(), default=0)
        counts["sets_not_applied"] = max(0, len(self._sets) - applied - expired)
        counts |= {key: value for key, value in sorted(total.items()) if key.startswith("rejected.")}
        return counts

    def summary(self) -> dict[str, Any]:
        """The record of the run; its keys are documented in docs/summary.md and stay."""
        found = self._posterior.found if self._posterior else np.zeros((self.mission.box().dimension, 0))
        end = self._posterior.time if self._posterior else 0.0
        truth = self.world.targets(end)
        pairs = matched(truth, found, self.mission.match_m)
        errors = np.array([np.linalg.norm(truth[:, i] - found[:, j]) for i, j in pairs])
        score = gospa(truth, found, c=self.mission.gospa_c_m, p=2.0)
        return {
            "mission": self.mission.name,
            "seed": self.seed,
            "driver": self.driver,
            "robots": len(self.mission.robots),
            "targets_total": self.targets_total,
            "targets_found": self._matches,
            "estimate_of": None if self._posterior is None else self._posterior.sender,
            "false_found": int(found.shape[1]) - len(pairs),
            "all_found": self.all_found,
            "time_to_all_found_s": self._all_found_at,
            "measurement_sets": self.measurement_sets,
            "measurements_to_all_found": self._applied_at_all_found if self.all_found else None,
            "rmse_m": float(np.sqrt(np.mean(errors**2))) if errors.size else None,
            "max_error_m": float(errors.max()) if errors.size else None,
            "gospa": score.total,
            "label_changes": self._label_changes,
            "expected_cardinality": self.expected_cardinality,
            "distance_travelled_m": {
                robot: sum(boots.values()) for robot, boots in sorted(self._travelled.items())
            },
            "min_separation_m": self._separation if np.isfinite(self._separation) else None,
            "plan_ms": _percentiles(self._histogram("plan_ms")),
            "capture_to_posterior_ms": _percentiles(self._histogram("capture_to_posterior_ms")),
            "measure_clock_lateness_ms": _percentiles(self._histogram("measure_clock_lateness_ms")),
            "tasks": self.tasks.summary(self._now),
            "messages": self._messages(),
            "memory_mb": {
                f"{message.role} {sender}": round(message.gauges["memory_mb"], 1)
                for (sender, _), message in sorted(self._health.items())
                if "memory_mb" in message.gauges
            },
            "vehicles": self._vehicles(),
            "found": found.T.tolist(),
            "curve": self._thinned_curve(),
        }

    def _vehicles(self) -> dict[str, Any]:
        """How near real vehicles came to their waypoints, and how they were at the last."""
        return {
            sender: {
                "waypoints": message.counters.get("mavlink.waypoints", 0),
                "waypoint_worst_m": message.gauges.get("mavlink.waypoint_worst_m"),
                "words": message.vehicle,
            }
            for (sender, _), message in sorted(self._health.items())
            if message.vehicle
        }

    def _thinned_curve(self) -> Mapping[str, list[float]]:
        """The course of the search at every change of the found targets and about 200 other moments."""
        stride = max(1, len(self._curve) // 200)
        kept = [
            row
            for i, row in enumerate(self._curve)
            if i % stride == 0 or i == len(self._curve) - 1 or row[2] != self._curve[i - 1][2]
        ]
        names = ("time_s", "sets_applied", "targets_found", "expected_cardinality")
        course = {name: [float(row[i]) for row in kept] for i, name in enumerate(names)}
        cutoff = self.mission.gospa_c_m
        course["gospa"] = [gospa(self.world.targets(row[0]), row[4], c=cutoff, p=2.0).total for row in kept]
        return course


def _percentiles(histogram: Histogram) -> dict[str, float | None]:
    return {"p50": histogram.percentile(50.0), "p99": histogram.percentile(99.0)}
