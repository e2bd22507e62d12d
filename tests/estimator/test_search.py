"""Found targets, their measurements, exploration: (MA)ASI section 3.3 and Algorithm 1."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area, Clusters
from estimator.gaussian.gm_phd import GmPhd
from estimator.lmb.lmb import Lmb
from estimator.motion import MotionConfig
from estimator.search import Search, SearchState
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd, SmcPhdState

AREA = Area(np.zeros(2), np.full(2, 100.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0, range_sigma_m=0.3, bearing_sigma_deg=0.5, reach_m=[40.0, 40.0], gain=0.95
    ),
    AREA,
)
POSE = np.array([50.0, 50.0, 5.0, 0.0])
TARGETS = np.array([[40.0, 62.0, 75.0], [45.0, 71.0, 40.0]])


def search(mass: float = 0.8, **filter: Any) -> Search[SmcPhdState]:
    config = SmcPhd.Config(**{"particles": 2000, "expected_targets": 3.0, **filter})
    return Search(SmcPhd(config), AREA, [11, 11], radius=1.0, mass=mass, gate=4.0)


def around(
    team: Search[SmcPhdState], steps: int, seed: int = 0, targets: FloatArray = TARGETS
) -> tuple[SearchState[SmcPhdState], np.random.Generator]:
    """The estimate after one robot circled the middle."""
    rng = np.random.default_rng(seed)
    state = team.init(rng)
    for k in range(steps):
        pose = np.array([50.0 + 20.0 * np.cos(0.4 * k), 50.0 + 20.0 * np.sin(0.4 * k), 5.0, 0.0])
        state = team.apply(state, SENSOR, pose, SENSOR.sample(targets, pose, rng), float(k), rng)
    return state, rng


@pytest.mark.parametrize("seed", range(4))
def test_every_target_is_found_near_its_place_and_nothing_else_is(seed: int) -> None:
    state, _ = around(search(), 60, seed)
    assert state.found.shape == (2, 3)
    gaps = np.linalg.norm(state.found[:, :, None] - TARGETS[:, None, :], axis=0).min(axis=1)
    assert (gaps < 0.3).all()
    assert (np.diff(state.found_times) >= 0).all()
    assert state.sets == 60
    assert state.time == 59.0


def test_expected_cardinality_counts_found_and_not_yet_found_targets() -> None:
    team = search()
    state, _ = around(team, 0)
    assert team.expected_cardinality(state) == pytest.approx(3.0)
    state, _ = around(team, 60)
    assert team.expected_cardinality(state) == pytest.approx(3.0, abs=0.3)


def test_found_targets_particles_are_removed_and_their_measurements_raise_no_new_peak() -> None:
    state, rng = around(search(), 60)
    assert state.filter_state.weights.sum() < 0.1
    again = search().apply(state, SENSOR, POSE, SENSOR.measure(TARGETS, POSE), 60.0, rng)
    assert again.clusters.masses.size == 0
    assert again.found.shape == state.found.shape


def test_found_targets_are_refined_by_the_measurements_they_take() -> None:
    state, rng = around(search(), 60)
    z = SENSOR.measure(TARGETS, POSE)
    after = search().apply(state, SENSOR, POSE, z, 60.0, rng)

    def error(found: FloatArray) -> float:
        return float(np.linalg.norm(found[:, :, None] - TARGETS[:, None, :], axis=0).min(axis=1).max())

    assert error(after.found) < error(state.found)
    traces = [np.trace(s.found_covariances, axis1=1, axis2=2) for s in (state, after)]
    assert (traces[1] < traces[0]).all()


def test_each_found_target_takes_at_most_one_measurement_and_only_within_the_gate() -> None:
    team = search()
    state, _ = around(team, 60)
    beside = TARGETS[:, :1] + np.array([[0.5], [0.0]])  # two measurements of one place: one is left
    both = SENSOR.measure(np.concatenate([TARGETS[:, :1], beside], axis=1), POSE)
    _, left, _ = team._without_found(state, SENSOR, POSE, both)
    assert np.allclose(left, both[1:])
    far = SENSOR.measure(TARGETS[:, :1] + 4.5, POSE)
    _, left, silent = team._without_found(state, SENSOR, POSE, far)
    assert np.array_equal(left, far)
    assert silent.all()


def test_a_target_is_not_found_before_it_is_heavy_enough() -> None:
    assert around(search(mass=50.0), 40)[0].found.shape[1] == 0


def test_exploration_falls_with_every_look_as_equation_20_says() -> None:
    team, rng = search(), np.random.default_rng(0)
    state = team.apply(team.init(rng), SENSOR, POSE, np.zeros((0, 2)), 0.0, rng)
    expected = 1.0 - SENSOR.detection(state.exploration.nodes(), POSE[None])[0]
    assert np.allclose(state.exploration.values.ravel(), expected)


def test_a_late_set_is_applied_without_time_going_back() -> None:
    team = search(birth=0.1)
    state, rng = around(team, 10)
    late = team.apply(state, SENSOR, POSE, np.zeros((0, 2)), 2.0, rng)
    assert late.time == state.time
    assert late.sets == 11


def test_applying_leaves_the_old_state_as_it_was() -> None:
    team = search()
    state, rng = around(team, 30)
    found, covariances = state.found.copy(), state.found_covariances.copy()
    team.apply(state, SENSOR, POSE, SENSOR.measure(TARGETS, POSE), 30.0, rng)
    assert np.array_equal(state.found, found)
    assert np.array_equal(state.found_covariances, covariances)


def test_the_same_seed_gives_the_same_bits() -> None:
    first, second = around(search(), 25, 4)[0], around(search(), 25, 4)[0]
    assert first.found.tobytes() == second.found.tobytes()
    assert first.filter_state.weights.tobytes() == second.filter_state.weights.tobytes()


@pytest.mark.parametrize(
    ("pose", "z", "time", "name"),
    [
        (np.zeros(2), np.zeros((0, 2)), 0.0, "pose"),
        (POSE, np.zeros((1, 5)), 0.0, "measurements"),
        (POSE, np.full((1, 2), np.nan), 0.0, "measurements"),
        (POSE, np.zeros((0, 2)), np.nan, "capture_time"),
    ],
)
def test_bad_input_is_refused_by_name(pose: FloatArray, z: FloatArray, time: float, name: str) -> None:
    team, rng = search(), np.random.default_rng(0)
    with pytest.raises(ValueError, match=name):
        team.apply(team.init(rng), SENSOR, pose, z, time, rng)


@pytest.mark.parametrize("seed", range(2))
def test_the_papers_cube_is_searched_without_false_targets(seed: int) -> None:
    """(MA)ASI section 5.1's sensor and thresholds but T_m, from a fixed sweep."""
    cube = Area(np.zeros(3), np.full(3, 260.0))
    model = RangeBearing.of(
        RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=1.5,
            bearing_sigma_deg=0.175,
            elevation_sigma_deg=0.295,
            reach_m=[25.0] * 3,
            gain=0.98,
        ),
        cube,
    )
    team = Search(
        SmcPhd(SmcPhd.Config(particles=3000, expected_targets=12.0)),
        cube,
        [9] * 3,
        radius=1.1,
        mass=0.9,
        gate=5.0,
    )
    rng = np.random.default_rng(seed)
    targets, state = rng.uniform(0, 260, (3, 12)), team.init(rng)
    for k in range(160):
        across = 130.0 + 110.0 * np.cos(0.35 * k)
        along = 130.0 + 110.0 * np.sin(0.13 * k)
        pose = np.array([across, along, 20.0 + 220.0 * (k % 80) / 80, 0.0])
        state = team.apply(state, model, pose, model.sample(targets, pose, rng), float(k), rng)
    gaps = np.linalg.norm(state.found[:, :, None] - targets[:, None, :], axis=0)
    assert gaps.shape == (12, 12)
    assert sorted(gaps.argmin(axis=1).tolist()) == list(range(12))
    assert np.sqrt(np.mean(gaps.min(axis=1) ** 2)) < 1.24


def moving(labelled: bool, seed: int, looks: int = 25) -> list[SearchState[Any]]:
    """The course of a search that keeps its found targets in the filter; two targets pass each other."""
    motion = MotionConfig(kind="constant_velocity", acceleration=0.1, speed=1.0)
    filter: Any = (
        Lmb(Lmb.Config(expected_targets=2.0, motion=motion))
        if labelled
        else GmPhd(GmPhd.Config(expected_targets=2.0, motion=motion))
    )
    team: Search[Any] = Search(filter, AREA, [5, 5], radius=2.0, mass=0.7, gate=6.0, remove=False)
    sensor = RangeBearing.of(
        RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=0.3,
            bearing_sigma_deg=0.5,
            gain=0.98,
            field_of_view="box",
            box_m=[(-100.0, 100.0)] * 2,
        ),
        AREA,
    )
    rng, course = np.random.default_rng(seed), []
    state = team.init(rng)
    for k in range(looks):
        targets = np.array([[30.0 + k, 60.0 - k], [40.0, 55.0]])
        state = team.apply(state, sensor, POSE, sensor.sample(targets, POSE, rng), float(k), rng)
        course.append(state)
    assert team.expected_cardinality(state) == pytest.approx(2.0, abs=0.2)  # found ones count once
    return course


@pytest.mark.parametrize("labelled", [True, False])
def test_found_targets_that_stay_in_the_filter_are_followed_as_they_move(labelled: bool) -> None:
    course = moving(labelled, 1)
    last = course[-1]
    assert last.found.shape == (2, 2)
    assert last.clusters.masses.size == 0
    names = {}
    for k, state in enumerate(course[5:], 5):
        for label, place in zip(state.found_labels.tolist(), state.found.T, strict=True):
            row = 0 if abs(place[1] - 40.0) < 7.0 else 1
            truth = [30.0 + k, 40.0] if row == 0 else [60.0 - k, 55.0]
            assert np.linalg.norm(place - truth) < 1.5
            assert names.setdefault(label, row) == row
    for place, velocity in zip(last.found.T, last.found_velocities.T, strict=True):
        np.testing.assert_allclose(velocity, [1.0 if place[1] < 47.0 else -1.0, 0.0], atol=0.25)
    assert len(names) == 2
    assert (np.diff([s.found_times.min() for s in course[5:]]) == 0.0).all()


def test_a_found_target_stays_found_while_its_cluster_keeps_half_the_mass() -> None:
    team = Search(FakeClusters(), AREA, [3, 3], radius=1.0, mass=0.8, gate=3.0, remove=False)
    rng = np.random.default_rng(0)
    state: SearchState[Any] = team.init(rng)
    found = []
    for k, mass in enumerate([0.9, 0.5, 0.41, 0.3, 0.7, 0.95]):
        state = replace(state, filter_state=mass)
        state = team.apply(state, SENSOR, POSE, np.zeros((0, 2)), float(k), rng)
        found.append(state.found_labels.tolist())
        assert state.clusters.masses.size == (0 if found[-1] else 1)
    assert found == [[0], [0], [0], [], [], [1]]


class FakeClusters(SmcPhd):
    """A filter whose state is the mass of its one cluster."""

    def __init__(self) -> None:
        super().__init__(SmcPhd.Config())

    def init(self, area: Area, rng: np.random.Generator) -> Any:
        return 0.0

    def predict(self, state: Any, duration: float, rng: np.random.Generator) -> Any:
        return state

    def update(self, state: Any, *arguments: Any) -> Any:
        return state

    def clusters(self, state: Any, rng: np.random.Generator) -> tuple[Any, Clusters]:
        spread = 0.25 * np.eye(2)[None]
        return state, Clusters(np.full((2, 1), 30.0), spread, np.array([state]), np.array([0.5]))
