"""What every filter promises, whatever it is made of. test_filters.py asks it of all that are installed."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from agents import plugins
from estimator.arrays import FloatArray
from estimator.filter import Area, Clusters
from estimator.sensors.range_bearing import RangeBearing

SIDE = 60.0
TARGETS = {
    2: np.array([[20.0, 41.0, 47.0], [22.0, 38.0, 15.0]]),
    3: np.array([[20.0, 41.0, 47.0], [22.0, 38.0, 15.0], [9.0, 14.0, 30.0]]),
}


@dataclass(frozen=True)
class Case:
    """One filter in one space."""

    kind: str
    dimension: int = 2
    table: dict[str, Any] = field(default_factory=dict)  # what its mission table says
    count: int = 3  # targets that it can hold at most, here

    @property
    def area(self) -> Area:
        return Area(np.zeros(self.dimension), np.full(self.dimension, SIDE))

    def filter(self, **changes: Any) -> Any:
        """The filter as a mission would make it; keys that it does not have are left out."""
        made = plugins.load("filters", self.kind)
        known = set(made.Config.__struct_fields__)
        wanted = {"expected_targets": 3.0, **self.table, **changes}
        return made(made.Config(**{key: value for key, value in wanted.items() if key in known}))

    @property
    def targets(self) -> FloatArray:
        """Where they are, (d, count)."""
        return np.ascontiguousarray(TARGETS[self.dimension][:, : self.count])

    def has(self, key: str) -> bool:
        return key in plugins.load("filters", self.kind).Config.__struct_fields__

    def sensor(self, **changes: Any) -> RangeBearing:
        d = self.dimension
        config = {
            "period_s": 1.0,
            "range_sigma_m": 0.3,
            "bearing_sigma_deg": 0.5,
            "elevation_sigma_deg": 0.5 if d == 3 else None,
            "reach_m": [60.0] * d,
            "gain": 0.95,
            "clutter": 0.3,
        }
        return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), self.area)

    def pose(self, k: int = 0) -> FloatArray:
        """One of the places from which the targets are looked at."""
        return np.array([30.0 + 6.0 * np.cos(k), 28.0 + 6.0 * np.sin(k), 12.0, 0.3 * k])

    def searched(self, filter: Any, looks: int = 12, seed: int = 1) -> tuple[Any, Clusters]:
        """State and clusters after some looks at all targets, as Search would call them.

        The last two looks happen to see every target: the mass of a PHD falls by 1 - p_D with each miss.
        """
        rng, sensor = np.random.default_rng(seed), self.sensor()
        lucky = self.sensor(gain=1.0, reach_m=[1e9] * self.dimension, clutter=0.0)
        state, clusters = filter.init(self.area, rng), Clusters.none(self.dimension)
        for k in range(looks):
            state = filter.predict(state, 1.0 if k else 0.0, rng)
            drawn = lucky if k >= looks - 2 else sensor
            z = drawn.sample(self.targets, self.pose(k), rng)
            state = filter.update(state, sensor, self.pose(k), z, rng)
            state, clusters = filter.clusters(state, rng)
        return state, clusters


def bits(state: Any) -> bytes:
    """A state's content, so that two can be compared."""
    return pickle.dumps(state)


def all_finite(value: Any) -> bool:
    """Whether no array or number anywhere in a state is NaN or infinite."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind != "f" or bool(np.isfinite(value).all())
    if isinstance(value, float | np.floating):
        return bool(np.isfinite(value))
    if isinstance(value, tuple | list):
        return all(map(all_finite, value))
    names = getattr(value, "__slots__", None) or getattr(value, "__dict__", ())
    if value is None or isinstance(value, Area | str | bytes | int):
        return True
    return all(all_finite(getattr(value, name)) for name in names if hasattr(value, name))


def the_prior_is_finite_and_of_the_missions_mass(case: Case) -> None:
    state = case.filter().init(case.area, np.random.default_rng(0))
    assert all_finite(state)
    if case.has("expected_targets"):
        assert case.filter().mass(state) == pytest.approx(3.0, rel=1e-6)


def no_time_changes_nothing_and_time_does_not_go_back(case: Case) -> None:
    filter, rng = case.filter(), np.random.default_rng(0)
    state, _ = case.searched(filter, 3)
    assert filter.mass(filter.predict(state, 0.0, rng)) == pytest.approx(filter.mass(state), rel=1e-12)
    for duration in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="duration"):
            filter.predict(state, duration, rng)


def births_and_survival_follow_the_duration(case: Case) -> None:
    if not (case.has("birth") and case.has("survival")):
        pytest.skip("no births, no deaths")
    filter, rng = case.filter(birth=0.5, survival=0.9), np.random.default_rng(0)
    state = filter.init(case.area, rng)
    later = filter.mass(filter.predict(state, 2.0, rng))
    assert later == pytest.approx(0.81 * filter.mass(state) + 1.0, rel=0.1)


def each_target_becomes_one_heavy_cluster(case: Case) -> None:
    _, clusters = case.searched(case.filter())
    heavy = clusters.masses > 0.5
    assert heavy.sum() == case.count
    for target in case.targets.T:
        off = np.linalg.norm(clusters.means[:, heavy] - target[:, None], axis=0).min()
        assert off < 0.6
    c = clusters.masses.size
    assert clusters.means.shape == (case.dimension, c)
    assert clusters.covariances.shape == (c, case.dimension, case.dimension)
    assert (np.diff(clusters.masses) <= 1e-12).all()
    assert all(np.linalg.eigvalsh(p).min() >= 0.0 for p in clusters.covariances)
    trace = np.trace(clusters.covariances, axis1=1, axis2=2)
    assert np.allclose(clusters.radii, np.sqrt(trace / case.dimension))


def a_robot_at_the_very_place_of_a_target_breaks_nothing(case: Case) -> None:
    for off in (0.0, 1e-12, 1e-6, 0.01, 0.3):
        for seed in range(5):
            filter, rng, sensor = case.filter(), np.random.default_rng(seed), case.sensor()
            state, place = filter.init(case.area, rng), np.zeros(4)
            place[: case.dimension] = case.targets[:, 0]
            place[0] += off
            for k in range(20):
                state = filter.predict(state, 0.2 if k % 5 == 4 else 0.0, rng)
                z = sensor.sample(case.targets, place, rng)
                state = filter.update(state, sensor, place, z, rng)
                state, clusters = filter.clusters(state, rng)
            said = f"{off} m off, seed {seed}"
            assert all_finite(state), said
            assert all(np.linalg.eigvalsh(p).min() >= 0.0 for p in clusters.covariances), said


def cardinality_comes_near_the_truth(case: Case) -> None:
    filter, rng, sensor, targets = (
        case.filter(),
        np.random.default_rng(5),
        case.sensor(),
        case.targets,
    )
    state, _ = case.searched(filter)
    masses = []
    for k in range(20):
        state = filter.update(state, sensor, case.pose(k), sensor.sample(targets, case.pose(k), rng), rng)
        state, clusters = filter.clusters(state, rng)
        off = np.linalg.norm(clusters.means[:, :, None] - targets[:, None, :], axis=0).min(axis=1)
        masses.append(clusters.masses[off < 1.0].sum())
    assert np.mean(masses) == pytest.approx(case.count, abs=0.3)


def labels_stay_with_their_targets(case: Case) -> None:
    filter, rng, sensor = case.filter(), np.random.default_rng(3), case.sensor(clutter=0.0, gain=1.0)
    state, clusters = case.searched(filter)
    if clusters.labels is None:
        pytest.skip("keeps no identities")
    before = dict(zip(clusters.labels[: case.count].tolist(), clusters.means[:, : case.count].T, strict=True))
    assert len(before) == case.count
    for k in range(4):
        z = sensor.sample(case.targets, case.pose(k), rng)
        state, clusters = filter.clusters(filter.update(state, sensor, case.pose(k), z, rng), rng)
    assert clusters.labels is not None
    after = dict(zip(clusters.labels[: case.count].tolist(), clusters.means[:, : case.count].T, strict=True))
    assert before.keys() == after.keys()
    assert all(np.linalg.norm(before[label] - after[label]) < 1.0 for label in before)


def removing_a_cluster_takes_its_mass_and_no_other(case: Case) -> None:
    filter = case.filter()
    state, clusters = case.searched(filter)
    after = filter.remove(state, np.array([case.count // 2]))
    assert filter.mass(after) == pytest.approx(
        filter.mass(state) - clusters.masses[case.count // 2], rel=1e-6
    )
    assert filter.mass(filter.remove(state, np.zeros(0, np.int64))) == pytest.approx(filter.mass(state))
    _, left = filter.clusters(after, np.random.default_rng(0))
    off = np.linalg.norm(left.means - clusters.means[:, [case.count // 2]], axis=0)
    assert not (left.masses[off < 1.0] > 0.5).any()


def the_order_of_measurements_does_not_matter(case: Case) -> None:
    filter = case.filter()
    state, _ = case.searched(filter)
    sensor, pose = case.sensor(), case.pose(5)
    z = sensor.sample(case.targets, pose, np.random.default_rng(7))
    one = filter.update(state, sensor, pose, z, np.random.default_rng(8))
    other = filter.update(state, sensor, pose, z[::-1], np.random.default_rng(8))
    assert filter.mass(other) == pytest.approx(filter.mass(one), rel=1e-6)


def where_nothing_can_be_detected_an_empty_set_changes_nothing(case: Case) -> None:
    filter = case.filter()
    state, _ = case.searched(filter)
    blind = case.sensor(gain=0.0)
    after = filter.update(state, blind, case.pose(), np.zeros((0, case.dimension)), np.random.default_rng(0))
    assert filter.mass(after) == pytest.approx(filter.mass(state), rel=1e-9)


def an_empty_set_takes_mass_where_the_sensor_looked(case: Case) -> None:
    if not case.has("expected_targets"):
        pytest.skip("its targets are known to exist")
    filter = case.filter()
    state, _ = case.searched(filter)
    nothing = np.zeros((0, case.dimension))
    after = filter.update(state, case.sensor(), case.pose(), nothing, np.random.default_rng(0))
    assert filter.mass(after) < 0.95 * filter.mass(state)


def the_same_seed_gives_the_same_bits(case: Case) -> None:
    assert bits(case.searched(case.filter(), 5)) == bits(case.searched(case.filter(), 5))


def no_call_changes_the_state_it_was_given(case: Case) -> None:
    filter, rng = case.filter(), np.random.default_rng(2)
    state, _ = case.searched(filter, 6)
    before = bits(state)
    z = case.sensor().sample(case.targets, case.pose(), rng)
    after, _ = filter.clusters(
        filter.update(filter.predict(state, 2.0, rng), case.sensor(), case.pose(), z, rng), rng
    )
    filter.remove(after, np.array([0]))
    filter.thinned(state, 50)
    filter.mass(state)
    assert bits(state) == before


def thinned_points_carry_the_whole_mass(case: Case) -> None:
    filter = case.filter()
    state, _ = case.searched(filter)
    for size in (1, 60, 2000):
        points, weights = filter.thinned(state, size)
        assert points.shape == (case.dimension, weights.size)
        assert 0 < weights.size <= size
        assert weights.sum() == pytest.approx(filter.mass(state), rel=1e-6)


def what_is_no_input_is_named_and_leaves_no_trace(case: Case) -> None:
    filter, d, rng = case.filter(), case.dimension, np.random.default_rng(0)
    state, _ = case.searched(filter, 3)
    good = np.ones((1, d))
    for argument, pose, z in (
        ("measurements", case.pose(), np.full((1, d), np.nan)),
        ("measurements", case.pose(), np.full((1, d), np.inf)),
        ("measurements", case.pose(), np.ones((1, d + 1))),
        ("measurements", case.pose(), np.ones(d)),
        ("pose", np.full(4, np.nan), good),
        ("pose", np.ones(3), good),
    ):
        with pytest.raises(ValueError, match=argument):
            filter.update(state, case.sensor(), pose, z, rng)


def hard_input_leaves_finite_states(case: Case) -> None:
    filter, d, rng = case.filter(), case.dimension, np.random.default_rng(0)
    fresh = filter.init(case.area, rng)
    for state in (fresh, case.searched(filter, 6)[0]):
        on_target = (
            np.append(TARGETS[d][:, 0], np.zeros(4 - d)) if d == 2 else np.append(TARGETS[3][:, 0], 0.0)
        )
        edge = np.zeros((4, d))
        edge[:, 0] = 10.0
        edge[:, 1] = [np.pi, -np.pi, 3.0 * np.pi, 0.0]
        for pose, z, clutter in (
            (on_target, np.zeros((1, d)), 0.3),  # range 0
            (case.pose(), edge, 0.3),
            (case.pose(), np.full((1, d), 1e4), 0.0),  # cannot have happened
            (case.pose(), np.full((1, d), -5.0), 0.0),
            (case.pose(), np.repeat(edge, 10, axis=0), 0.3),
        ):
            after = filter.update(state, case.sensor(clutter=clutter), pose, z, rng)
            after, clusters = filter.clusters(after, rng)
            assert all_finite(after)
            assert all_finite(clusters)
            assert np.isfinite(filter.mass(after))


def a_state_without_anything_left_goes_on(case: Case) -> None:
    filter, rng = case.filter(expected_targets=0.0), np.random.default_rng(0)
    state = filter.init(case.area, rng)
    z = np.full((1, case.dimension), 1.0)
    state = filter.update(filter.predict(state, 1.0, rng), case.sensor(), case.pose(), z, rng)
    state, _ = filter.clusters(state, rng)
    filter.thinned(state, 10)
    assert all_finite(state)


PROMISES: list[Callable[[Case], None]] = [
    the_prior_is_finite_and_of_the_missions_mass,
    no_time_changes_nothing_and_time_does_not_go_back,
    births_and_survival_follow_the_duration,
    each_target_becomes_one_heavy_cluster,
    a_robot_at_the_very_place_of_a_target_breaks_nothing,
    cardinality_comes_near_the_truth,
    labels_stay_with_their_targets,
    removing_a_cluster_takes_its_mass_and_no_other,
    the_order_of_measurements_does_not_matter,
    where_nothing_can_be_detected_an_empty_set_changes_nothing,
    an_empty_set_takes_mass_where_the_sensor_looked,
    the_same_seed_gives_the_same_bits,
    no_call_changes_the_state_it_was_given,
    thinned_points_carry_the_whole_mass,
    what_is_no_input_is_named_and_leaves_no_trace,
    hard_input_leaves_finite_states,
    a_state_without_anything_left_goes_on,
]
