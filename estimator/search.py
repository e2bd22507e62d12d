"""The team's estimate: any filter, plus the targets found so far and the exploration function.

(MA)ASI section 3.3 and Algorithm 1, lines 15-19: Yousuf, Herzal, Lendek, Buşoniu, Control Engineering
Practice, 2024.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.exploration import Exploration
from estimator.filter import Area, Clusters, Filter, Listening
from estimator.matching import apart, closest, together
from estimator.sensor import SensorModel, checked_poses, validated
from estimator.sensors.known import bare, with_known
from estimator.sensors.teammates import Poses, Teammates
from estimator.soft.statement import SoftObservation

State = TypeVar("State")

_SURPRISE = 4.0  # standard deviations beyond which a removed measurement does not refine its found target


@dataclass(frozen=True, slots=True, eq=False)
class SearchState(Generic[State]):
    """Everything the team knows after some measurement sets."""

    time: float  # s, team time of the newest set
    filter_state: State
    clusters: Clusters  # estimated targets not yet found
    found: FloatArray  # (d, f) found targets, refined by what is measured of them afterwards
    found_covariances: FloatArray  # (f, d, d) m^2
    found_times: FloatArray  # (f,) s, when each was found
    found_labels: IntArray  # (f,) identities of the found targets, that last over time
    found_velocities: FloatArray  # (d, f) m/s; 0 of those that stand, or whose filter estimates none
    named: int  # identities given out, where the filter has none
    exploration: Exploration
    sets: int  # applied so far
    clustered: float  # s, when clusters were last looked for
    poses: Poses  # of each robot's last set, if teammates are expected to be seen


class Search(Generic[State]):
    """Applies measurement sets one by one. Holds only what never changes; the estimate is in the state."""

    def __init__(
        self,
        filter: Filter[State],
        area: Area,
        exploration_points: Sequence[int],
        *,
        radius: float,
        mass: float,
        gate: float,
        same: float = 0.0,
        blur: float = 0.0,
        period: float = 0.0,
        teammates: Teammates | None = None,
        remove: bool = True,
    ) -> None:
        """`radius` T_r (m), `mass` T_m (targets) and `gate` T_z (m) of section 3.3.

        A cluster of smaller radius and greater mass is a found target, unless it is less than `same` standard
        deviations from one found before: then it is that one, and refines it. With a `blur` (m), measurements
        of found targets are off by more than noise (calibration, poses): what is left of them next to a
        target is still explained by it. With `teammates`, robots expect to see each other.
        Clusters are looked for at most once in `period` seconds; 0 is after every set.

        Without `remove` found targets stay in the filter, which is for those that move: they are then the
        clusters that are narrow and heavy enough, each for as long as its cluster keeps half the mass.
        """
        self.filter = filter
        self.area = area
        self.radius = radius
        self.threshold = mass
        self.gate = gate
        self.same = same
        self.blur = blur
        self.period = period
        self.teammates = teammates
        self.remove = remove
        self._unexplored = Exploration.unexplored(area, tuple(exploration_points))

    def __repr__(self) -> str:
        return f"Search({self.filter}, T_r={self.radius:g}, T_m={self.threshold:g}, T_z={self.gate:g})"

    def init(self, rng: np.random.Generator) -> SearchState[State]:
        """Nothing found, nothing explored, at time 0."""
        d = self.area.dimension
        return SearchState(
            time=0.0,
            filter_state=self.filter.init(self.area, rng),
            clusters=Clusters.none(d),
            found=np.zeros((d, 0)),
            found_covariances=np.zeros((0, d, d)),
            found_times=np.zeros(0),
            found_labels=np.zeros(0, np.int64),
            found_velocities=np.zeros((d, 0)),
            named=0,
            exploration=self._unexplored,
            sets=0,
            clustered=-np.inf,
            poses=self.teammates.starts if self.teammates else {},
        )

    def apply(
        self,
        state: SearchState[State],
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        capture_time: float,
        rng: np.random.Generator,
        robot: str = "",
    ) -> SearchState[State]:
        """The estimate after one more set (m, s), taken by `sensor` at pose (4,) and time `capture_time`.

        A set older than the newest is applied as if it were taken with it. `robot` says whose set it is; that
        matters only where teammates are expected.

        Raises:
            ValueError: if an argument has a wrong shape or is not finite; names it.
        """
        if not np.isfinite(capture_time):
            raise ValueError(f"capture_time: must be finite, got {capture_time}")
        pose = checked_poses(pose)[0]
        measurements = validated(measurements, sensor.measurement_size)
        if self.teammates is not None:
            if capture_time >= state.time:
                state = replace(state, poses={**state.poses, robot: pose})
            if len(measurements):
                sensor = self.teammates.expected_by(robot, sensor, state.poses)
        silent = np.zeros(0, np.bool_)
        if self.remove:
            state, measurements, silent = self._without_found(state, sensor, pose, measurements)
        if len(measurements) and silent.any():
            # A found target makes one measurement at most. Where none was near enough to be taken for it, it
            # may still be the source of one further away, which then is no news of another target.
            places = np.ascontiguousarray(state.found[:, silent])
            variances = np.trace(state.found_covariances[silent], axis1=1, axis2=2) / len(places)
            rates = sensor.detection(places, pose[None, :])[0]
            if self.blur > 0.0:  # makes up for the lower peak
                rates = np.ones_like(rates)
            sensor = with_known(sensor, places, np.sqrt(variances + self.blur**2), rates)
        now = max(capture_time, state.time)
        inner = self.filter.predict(state.filter_state, now - state.time, rng)
        inner = self.filter.update(inner, sensor, pose, measurements, rng)
        state = replace(
            state,
            time=now,
            filter_state=inner,
            exploration=state.exploration.after(bare(sensor), pose),
            sets=state.sets + 1,
        )
        return self._clustered(state, rng)

    def observe(
        self,
        state: SearchState[State],
        statement: SoftObservation,
        capture_time: float,
        rng: np.random.Generator,
    ) -> SearchState[State]:
        """The estimate after an operator's statement that was true at time `capture_time`.

        One older than the newest set is applied as if it were said with it. Nobody looked, so the exploration
        function stays as it is.

        Raises:
            ValueError: if the time is not finite, or the filter cannot take the statement; says why.
        """
        if not np.isfinite(capture_time):
            raise ValueError(f"capture_time: must be finite, got {capture_time}")
        if not isinstance(self.filter, Listening):
            raise ValueError("filter: it takes no soft observations")
        now = max(capture_time, state.time)
        inner = self.filter.predict(state.filter_state, now - state.time, rng)
        known = None
        if self.remove and state.found.shape[1]:
            known = statement.softmax.probabilities(state.found)[statement.category]
        inner = self.filter.observe(inner, statement, rng, known=known)
        return self._clustered(replace(state, time=now, filter_state=inner), rng)

    def expected_cardinality(self, state: SearchState[State]) -> float:
        """Mass of the intensity plus found targets that are no longer in it."""
        removed = state.found.shape[1] if self.remove else 0
        return float(self.filter.mass(state.filter_state) + removed)

    def thinned(self, state: SearchState[State], size: int) -> tuple[FloatArray, FloatArray]:
        """At most `size` points (d, k) with weights (k,) that stand for the intensity, for people."""
        return self.filter.thinned(state.filter_state, size)

    def _clustered(self, state: SearchState[State], rng: np.random.Generator) -> SearchState[State]:
        """With clusters and found targets as they are now, unless they were looked for a moment ago."""
        if state.time - state.clustered < self.period:
            return state
        inner, clusters = self.filter.clusters(state.filter_state, rng)
        state = replace(state, filter_state=inner, clusters=clusters, clustered=state.time)
        return self._with_new_found(state) if self.remove else self._with_followed(state)

    def _without_found(
        self, state: SearchState[State], sensor: SensorModel, pose: FloatArray, measurements: FloatArray
    ) -> tuple[SearchState[State], FloatArray, BoolArray]:
        """Take from each found target the closest measurement within T_z, and refine the target with it.

        The state, the measurements left, and which found targets (f,) had none near.
        """
        silent = np.ones(state.found.shape[1], dtype=np.bool_)
        if state.found.shape[1] == 0 or len(measurements) == 0:
            return state, measurements, silent
        places = sensor.locate(measurements, pose)
        targets, taken = closest(state.found, places, self.gate)
        if taken.size == 0:
            return state, measurements, silent
        silent[targets] = False
        spreads = sensor.location_covariance(measurements, pose)
        found, covariances = state.found.copy(), state.found_covariances.copy()
        for i, j in zip(targets, taken, strict=True):
            if apart(found[:, i], covariances[i], places[:, j], spreads[j]) < _SURPRISE:
                found[:, i], covariances[i] = together(found[:, i], covariances[i], places[:, j], spreads[j])
        left = np.delete(measurements, taken, axis=0)
        return replace(state, found=found, found_covariances=covariances), left, silent

    def _with_new_found(self, state: SearchState[State]) -> SearchState[State]:
        """Mark and remove clusters that are narrow and heavy enough."""
        clusters = state.clusters
        new = (clusters.radii < self.radius) & (clusters.masses > self.threshold)
        if not new.any():
            return state
        found, covariances = list(state.found.T), list(state.found_covariances)
        for c in np.flatnonzero(new):
            mean, covariance = clusters.means[:, c], clusters.covariances[c]
            blurred = covariance + self.blur**2 * np.eye(len(mean))
            gaps = [apart(f, p, mean, blurred) for f, p in zip(found, covariances, strict=True)]
            nearest = int(np.argmin(gaps)) if gaps else -1
            if nearest >= 0 and gaps[nearest] < self.same:
                found[nearest], covariances[nearest] = together(
                    found[nearest], covariances[nearest], mean, covariance
                )
            else:
                found.append(mean)
                covariances.append(covariance)
        more = len(found) - state.found.shape[1]
        return replace(
            state,
            filter_state=self.filter.remove(state.filter_state, np.flatnonzero(new)),
            clusters=clusters.chosen(~new),
            found=np.stack(found, axis=1),
            found_covariances=np.stack(covariances),
            found_times=np.concatenate([state.found_times, np.full(more, state.time)]),
            found_labels=np.append(state.found_labels, np.arange(state.named, state.named + more)),
            found_velocities=np.zeros((len(clusters.means), len(found))),
            named=state.named + more,
        )

    def _with_followed(self, state: SearchState[State]) -> SearchState[State]:
        """The found targets as their clusters now are: those of before, then new ones.

        A found target is followed by its cluster's label, without labels by the nearest cluster within T_z.
        """
        clusters = state.clusters
        count = clusters.masses.size
        before = np.full(count, -1)  # which found target each cluster was
        if clusters.labels is not None:
            known = {label: i for i, label in enumerate(state.found_labels.tolist())}
            before = np.array([known.get(label, -1) for label in clusters.labels.tolist()], np.int64)
        elif count and state.found.shape[1]:
            targets, taken = closest(state.found, clusters.means, self.gate)
            before[taken] = targets
        was = before >= 0
        new = ~was & (clusters.radii < self.radius) & (clusters.masses > self.threshold)
        stay = was & (clusters.masses > 0.5 * self.threshold)
        old = np.flatnonzero(stay)
        old = old[np.argsort(before[old], kind="stable")]
        order = np.concatenate([old, np.flatnonzero(new)])
        fresh = order.size - old.size
        if clusters.labels is None:
            names = np.arange(state.named, state.named + fresh)
            labels = np.append(state.found_labels[before[old]], names)
        else:
            labels = clusters.labels[order]
        return replace(
            state,
            clusters=clusters.chosen(~(new | stay)),
            found=np.ascontiguousarray(clusters.means[:, order]),
            found_covariances=clusters.covariances[order],
            found_times=np.concatenate([state.found_times[before[old]], np.full(fresh, state.time)]),
            found_labels=labels,
            found_velocities=velocities_of(clusters.chosen(order)),
            named=state.named + fresh,
        )


def velocities_of(clusters: Clusters) -> FloatArray:
    """Velocities (d, c) of clusters, 0 where their filter estimates none."""
    return np.zeros_like(clusters.means) if clusters.velocities is None else clusters.velocities
