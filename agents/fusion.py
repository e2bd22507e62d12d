"""The Fusion: applies the ledger to the filter and says what the team believes.

A state machine like the Robot. Sets are applied in the order (capture time, robot, boot, sequence), each
once; late ones within the rollback window are put in their place. The posterior is a function of the ledger
alone: the generator of each set's draws is seeded by the set's own identity.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from agents.machine import Action, Event, Heard, Publish, Stamp, Store
from agents.messages import EventMessage, MeasurementSetMessage, PictureMessage, PosteriorMessage
from agents.mission import Mission
from agents.seeds import generator
from agents.timeline import Arrival, Timeline
from agents.topics import EVENT, PICTURE, POSTERIOR
from agents.watermark import Applied
from estimator.search import Search, SearchState
from estimator.sensor import SensorModel

PICTURE_POINTS = 1500  # of the thinned intensity


@dataclass(frozen=True, slots=True)
class FusionSetup:
    """What a fusion is made with."""

    mission: Mission
    id: str
    boot: str
    search: Search[Any]
    sensors: Mapping[str, SensorModel]


class Fusion:
    """The team's estimate. `step` is the only way in; `restore` feeds it a ledger first."""

    def __init__(self, setup: FusionSetup, seed: int) -> None:
        mission = setup.mission
        self.id = setup.id
        self.stamp = Stamp(mission.team, setup.id, setup.boot)
        self.applied = Applied()
        self.counters: Counter[str] = Counter()
        self._mission = mission
        self._search = setup.search
        self._sensors = setup.sensors
        self._seed = seed
        self._timeline: Timeline[SearchState[Any], MeasurementSetMessage] = Timeline(
            setup.search.init(generator(seed, "fusion", "prior")),
            partial(_apply, setup.search, setup.sensors, seed),
            mission.fusion.rollback_s,
        )
        self._picture_at = 0.0
        self._found = 0
        self._sets = 0

    def __repr__(self) -> str:
        return f"Fusion({self.id}, applied={self._sets}, found={self._found}, {dict(self.counters)})"

    @property
    def search_state(self) -> SearchState[Any]:
        """The estimate after everything applied."""
        return self._timeline.state

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        return self._picture_at

    def restore(self, sets: Sequence[MeasurementSetMessage]) -> None:
        """Apply what an earlier life stored, in the order of its arrival."""
        for message in sets:
            self._accept([message])

    def step(self, now: float, events: Sequence[Event]) -> list[Action]:
        """Take in what happened up to `now`; answer what to store and to publish, in order."""
        new: list[MeasurementSetMessage] = []
        seen: set[tuple[str, str, int]] = set()
        for event in events:
            if not (isinstance(event, Heard) and isinstance(event.message, MeasurementSetMessage)):
                continue
            message = event.message
            identity = (message.sender, message.boot, message.sequence)
            if not self._welcome(message):
                continue
            if identity in seen or message in self.applied:
                self.counters["duplicate_sets"] += 1
                continue
            seen.add(identity)
            new.append(message)
        actions: list[Action] = []
        if new:
            # Sets that came together are stored and shown together, each applied in its place.
            new.sort(key=lambda m: (m.time, m.sender, m.boot, m.sequence))
            self._accept(new)
            actions += [Store(new), Publish(POSTERIOR, self._posterior())]
            actions += self._announce(now)
        if now >= self._picture_at:
            period = self._mission.fusion.picture_period_s
            self._picture_at += period * (1 + max(0, int((now - self._picture_at) / period)))
            actions.append(Publish(PICTURE, self._picture()))
            if not new:
                actions.append(Publish(POSTERIOR, self._posterior()))
        return actions

    def _welcome(self, message: MeasurementSetMessage) -> bool:
        sensor = self._sensors.get(message.sender)
        if sensor is None:
            self.counters["rejected.unknown_robot"] += 1
            return False
        if message.measurements.shape[1] != sensor.measurement_size:
            self.counters["rejected.measurement_size"] += 1
            return False
        return True

    def _accept(self, messages: Sequence[MeasurementSetMessage]) -> None:
        """Apply sets in the ledger's order; behind the place of the first, all is applied again only once."""
        timeline, counters = self._timeline, self.counters
        items = []
        for message in messages:
            self.applied.add(message)
            key = (message.time, message.sender, message.boot, message.sequence)
            if not timeline.too_late(key):
                items.append((key, message))
            elif self._mission.fusion.late_sets == "expire":
                counters["expired_sets"] += 1
            else:
                timeline.append(message)
                counters["late_sets"] += 1
                self._sets += 1
        for arrival in timeline.insert_all(items):
            counters["late_sets"] += arrival is not Arrival.IN_ORDER
        self._sets += len(items)
        counters["applied_sets"] = self._sets
        counters["reapplied_sets"] = timeline.reapplied

    def _posterior(self) -> PosteriorMessage:
        state = self._timeline.state
        clusters = state.clusters
        return PosteriorMessage(
            **self.stamp.header(POSTERIOR, state.time),
            watermark=self.applied.watermarks(),
            applied=self._sets,
            expected_cardinality=self._search.expected_cardinality(state),
            means=clusters.means,
            covariances=clusters.covariances,
            masses=clusters.masses,
            radii=clusters.radii,
            found=state.found,
            found_times=state.found_times,
            found_labels=state.found_labels,
        )

    def _picture(self) -> PictureMessage:
        state = self._timeline.state
        points, weights = self._search.thinned(state, PICTURE_POINTS)
        return PictureMessage(
            **self.stamp.header(PICTURE, state.time),
            exploration=np.round(state.exploration.values * 255.0).astype(np.uint8),
            points=points.astype(np.float32),
            weights=weights.astype(np.float32),
        )

    def _announce(self, now: float) -> list[Action]:
        found = self._timeline.state.found
        count = found.shape[1]
        if count == self._found:
            return []
        text = f"{count} targets found"
        if count > self._found:
            where = "; ".join(
                "(" + ", ".join(f"{x:.1f}" for x in found[:, i]) + ")" for i in range(self._found, count)
            )
            text += f", the newest at {where}"
        self._found = count
        return [Publish(EVENT, EventMessage(**self.stamp.header(EVENT, now), level="info", text=text))]


def _apply(
    search: Search[Any],
    sensors: Mapping[str, SensorModel],
    seed: int,
    state: SearchState[Any],
    message: MeasurementSetMessage,
) -> SearchState[Any]:
    """The estimate after one more set. Same set, same draws: that is what makes replays exact."""
    rng = generator(seed, "fusion", message.sender, message.boot, message.sequence)
    sender = message.sender
    return search.apply(state, sensors[sender], message.pose, message.measurements, message.time, rng, sender)
