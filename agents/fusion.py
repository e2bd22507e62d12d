"""The Fusion: applies the ledger to the filter and says what the team believes.

A state machine like the Robot. Measurement sets and operators' soft observations are applied in the order
(capture time, sender, boot, sequence), each once; late ones within the rollback window are put in their
place. The posterior is a function of the ledger alone: the generator of each entry's draws is seeded by the
entry's own identity.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from agents.admission import Admission, Identity, about, identity
from agents.machine import Action, Event, Heard, Publish, Stamp, Store
from agents.messages import (
    EventMessage,
    LedgerEntry,
    MeasurementSetMessage,
    PictureMessage,
    PosteriorMessage,
    SoftObservationMessage,
)
from agents.mission import Mission
from agents.seeds import generator
from agents.statements import observation, words
from agents.timeline import Arrival, Key, Timeline
from agents.topics import EVENT, PICTURE, POSTERIOR
from agents.watermark import Applied
from estimator.search import Search, SearchState, velocities_of
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
        self._admission = Admission(mission, setup.search, setup.sensors, self.counters)
        self._void: dict[Identity, str] = {}  # statements that change nothing where they stand, and why
        self._timeline: Timeline[SearchState[Any], LedgerEntry] = Timeline(
            setup.search.init(generator(seed, "fusion", "prior")),
            partial(_apply, setup.search, setup.sensors, seed, self._void),
            mission.fusion.rollback_s,
        )
        self._picture_at = 0.0
        self._found = 0
        self._sets = 0
        self._statements = 0

    def __repr__(self) -> str:
        return f"Fusion({self.id}, applied={self._sets}, found={self._found}, {dict(self.counters)})"

    @property
    def search_state(self) -> SearchState[Any]:
        """The estimate after everything applied."""
        return self._timeline.state

    def next_wake(self) -> float:
        """The team time at which `step` must be called even if nothing happens."""
        return self._picture_at

    def restore(self, entries: Sequence[LedgerEntry]) -> None:
        """Apply what an earlier life stored, in the order of its arrival."""
        for entry in entries:
            self._accept([entry])

    def step(self, now: float, events: Sequence[Event]) -> list[Action]:
        """Take in what happened up to `now`; answer what to store and to publish, in order."""
        new: list[LedgerEntry] = []
        seen: set[Identity] = set()
        actions: list[Action] = []
        for event in events:
            if not (isinstance(event, Heard) and isinstance(event.message, LedgerEntry)):
                continue
            entry = event.message
            if identity(entry) in seen or entry in self.applied:
                self.counters[f"duplicate_{_kind(entry)}"] += 1
                continue
            refusal = self._admission.refusal(entry, now, self._timeline.state, self._statements)
            if refusal is None:
                seen.add(identity(entry))
                new.append(entry)
            elif refusal and isinstance(entry, SoftObservationMessage):
                actions.append(self._answer(now, entry, f"refused: {refusal}"))
        if new:
            # Entries that came together are stored and shown together, each applied in its place.
            new.sort(key=lambda m: (m.time, m.sender, m.boot, m.sequence))
            expired = self._accept(new)
            actions.append(Store(new))
            for entry in new:
                if isinstance(entry, SoftObservationMessage):
                    objection = "changes nothing: it came too late" if identity(entry) in expired else ""
                    if identity(entry) in self._void:
                        objection = f"changes nothing: {self._void[identity(entry)]}"
                    actions.append(self._answer(now, entry, objection))
            actions.append(Publish(POSTERIOR, self._posterior()))
            actions += self._announce(now)
        if now >= self._picture_at:
            period = self._mission.fusion.picture_period_s
            self._picture_at += period * (1 + max(0, int((now - self._picture_at) / period)))
            actions.append(Publish(PICTURE, self._picture()))
            if not new:
                actions.append(Publish(POSTERIOR, self._posterior()))
        return actions

    def _accept(self, entries: Sequence[LedgerEntry]) -> set[Identity]:
        """Apply entries in the ledger's order; behind the place of the first, all is applied again only once.

        Those that came too late to be applied are the answer.
        """
        timeline, counters = self._timeline, self.counters
        items: list[tuple[Key, LedgerEntry]] = []
        expired = set()
        for entry in entries:
            self.applied.add(entry)
            key = (entry.time, entry.sender, entry.boot, entry.sequence)
            if not timeline.too_late(key):
                items.append((key, entry))
            elif self._mission.fusion.late_sets == "expire":
                counters[f"expired_{_kind(entry)}"] += 1
                expired.add(identity(entry))
                continue
            else:
                timeline.append(entry)
                counters[f"late_{_kind(entry)}"] += 1
            if isinstance(entry, MeasurementSetMessage):
                self._sets += 1
            else:
                self._statements += 1
        for (_, entry), arrival in zip(items, timeline.insert_all(items), strict=True):
            counters[f"late_{_kind(entry)}"] += arrival is not Arrival.IN_ORDER
        counters["applied_sets"] = self._sets
        counters["reapplied_sets"] = timeline.reapplied
        if self._statements:
            counters["applied_soft_observations"] = self._statements
        return expired

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
            velocities=velocities_of(clusters),
            found=state.found,
            found_covariances=state.found_covariances,
            found_velocities=state.found_velocities,
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

    def _answer(self, now: float, statement: SoftObservationMessage, objection: str) -> Action:
        """Tell people, and the operator, what was said and what became of it."""
        text = f"{statement.sender} says: {words(statement)}" + (f" ({objection})" if objection else "")
        header = self.stamp.header(EVENT, now)
        level = "warning" if objection else "info"
        return Publish(EVENT, EventMessage(**header, level=level, text=text, about=about(statement)))


def _kind(entry: LedgerEntry) -> str:
    """How counters name it."""
    return "sets" if isinstance(entry, MeasurementSetMessage) else "soft_observations"


def _apply(
    search: Search[Any],
    sensors: Mapping[str, SensorModel],
    seed: int,
    void: dict[Identity, str],
    state: SearchState[Any],
    message: LedgerEntry,
) -> SearchState[Any]:
    """The estimate after one more entry. Same entry, same draws: that is what makes replays exact."""
    rng = generator(seed, "fusion", message.sender, message.boot, message.sequence)
    sender = message.sender
    if isinstance(message, SoftObservationMessage):
        void.pop(identity(message), None)
        try:
            return search.observe(state, observation(message, search.area.dimension), message.time, rng)
        except ValueError as error:  # such as of a target that was found before: true, and no news
            void[identity(message)] = str(error)[:300]
            return state
    return search.apply(state, sensors[sender], message.pose, message.measurements, message.time, rng, sender)
