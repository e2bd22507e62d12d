"""A cluster that is an already found target, and one that is not."""

import numpy as np
import pytest

from estimator.arrays import FloatArray, IntArray
from estimator.filter import Area, Clusters
from estimator.search import Search, SearchState
from estimator.sensor import SensorModel
from estimator.sensors.range_bearing import RangeBearing

AREA = Area(np.zeros(2), np.full(2, 100.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(period_s=1.0, range_sigma_m=1.0, bearing_sigma_deg=1.0, reach_m=[40.0, 40.0]), AREA
)
POSE = np.array([5.0, 5.0, 0.0, 0.0])
State = tuple[Clusters, ...]  # to be reported, one after each set


class Scripted:
    """A filter that reports given clusters, whatever is measured."""

    def __init__(self, *script: Clusters) -> None:
        self.script = script

    def init(self, area: Area, rng: np.random.Generator) -> State:
        return self.script

    def predict(self, state: State, duration: float, rng: np.random.Generator) -> State:
        return state

    def update(
        self,
        state: State,
        sensor: SensorModel,
        pose: FloatArray,
        measurements: FloatArray,
        rng: np.random.Generator,
    ) -> State:
        return state

    def clusters(self, state: State, rng: np.random.Generator) -> tuple[State, Clusters]:
        return state[1:], state[0]

    def remove(self, state: State, clusters: IntArray) -> State:
        return state

    def mass(self, state: State) -> float:
        return 0.0

    def thinned(self, state: State, size: int) -> tuple[FloatArray, FloatArray]:
        return np.zeros((2, 0)), np.zeros(0)


def cluster(*places: tuple[float, float], variance: tuple[float, float] = (1.0, 1.0)) -> Clusters:
    c = len(places)
    return Clusters(
        np.array(places, dtype=float).T, np.tile(np.diag(variance), (c, 1, 1)), np.ones(c), np.full(c, 0.5)
    )


def found_of(same: float, *script: Clusters) -> SearchState[State]:
    search = Search(Scripted(*script), AREA, [3, 3], radius=1.0, mass=0.5, gate=1.0, same=same)
    rng = np.random.default_rng(0)
    state = search.init(rng)
    for k in range(len(script)):
        state = search.apply(state, SENSOR, POSE, np.zeros((0, 2)), float(k), rng)
    return state


def test_a_target_found_twice_is_one_between_and_better_known() -> None:
    west, south = (
        cluster((54.0, 50.0), variance=(3.0, 0.1)),
        cluster((50.0, 50.2), variance=(0.1, 3.0)),
    )
    state = found_of(4.0, west, south)
    assert state.found.shape == (2, 1)
    # the weighted mean of two independent estimates, per axis
    assert state.found[:, 0] == pytest.approx([(54 / 3 + 50 / 0.1) / (1 / 3 + 1 / 0.1), 50.0064516], rel=1e-6)
    assert np.diag(state.found_covariances[0]) == pytest.approx([3 / 31, 3 / 31])
    assert state.found_times.tolist() == [0.0]
    assert state.clusters.masses.size == 0


def test_two_clusters_of_one_target_found_at_once_are_one() -> None:
    assert found_of(4.0, cluster((50.0, 50.0), (51.0, 50.0), (90.0, 50.0))).found.shape == (2, 2)


def test_what_is_further_away_than_noise_explains_is_another_target() -> None:
    narrow = [cluster((50.0, 50.0 + k), variance=(0.01, 0.01)) for k in range(2)]
    state = found_of(4.0, *narrow)  # 1 m is 7 standard deviations here
    assert state.found.shape == (2, 2)
    assert state.found_times.tolist() == [0.0, 1.0]


def test_by_default_every_narrow_and_heavy_cluster_is_a_new_target() -> None:
    assert found_of(0.0, *[cluster((50.0, 50.0))] * 3).found.shape == (2, 3)


@pytest.mark.parametrize(("blur", "found"), [(0.0, 2), (2.0, 1)])
def test_blurred_measurements_make_a_found_target_of_few_sigmas_one_with_its_double(
    blur: float, found: int
) -> None:
    clusters = [cluster((50.0, 50.0), variance=(0.01, 0.01)), cluster((52.0, 51.0), variance=(0.01, 0.01))]
    search = Search(Scripted(*clusters), AREA, [5, 5], radius=1.0, mass=0.5, gate=1.0, same=3.0, blur=blur)
    rng = np.random.default_rng(0)
    state = search.init(rng)
    for time in (0.0, 1.0):
        state = search.apply(state, SENSOR, POSE, np.zeros((0, 2)), time, rng)
    assert state.found.shape[1] == found
