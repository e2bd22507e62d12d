"""Several sensors' sets applied to Gaussian components at once."""

from itertools import permutations
from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.gaussian.gm_phd import GmPhd, GmPhdState
from estimator.multisensor import Take, jointly_corrected
from estimator.sensors.range_bearing import RangeBearing
from tests.estimator.gaussian.test_gm_phd import TARGETS, given_state, mixture, on_grid, plain, points_moments

AREA = Area(np.zeros(2), np.full(2, 100.0))
POSES = [np.array([50.0, 50.0, 5.0, 0.3]), np.array([20.0, 60.0, 5.0, 0.0]), np.array([70.0, 30.0, 5.0, 2.0])]
POSES.append(np.array([45.0, 80.0, 5.0, 1.0]))


def sensor(**changes: Any) -> RangeBearing:
    config = {
        "period_s": 1.0,
        "range_sigma_m": 0.5,
        "bearing_sigma_deg": 1.0,
        "reach_m": [100.0, 100.0],
        "gain": 0.9,
        "clutter": 0.5,
    }
    return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), AREA)


def takes(targets: FloatArray = TARGETS, seed: int = 0, **changes: Any) -> list[Take]:
    rng = np.random.default_rng(seed)
    models = [sensor(gain=0.6 + 0.1 * k, **changes) for k in range(len(POSES))]
    return [Take(m, pose, m.sample(targets, pose, rng)) for m, pose in zip(models, POSES, strict=True)]


def rows(state: GmPhdState) -> FloatArray:
    c = state.components
    table = np.column_stack([c.weights, c.means, c.covariances.reshape(c.count, -1)])
    return np.asarray(table[np.lexsort(np.round(table[:, 1:3].T, 6))])


@pytest.mark.parametrize("seed", range(3))
def test_any_order_of_four_sensors_gives_the_same_to_1e_9(seed: int) -> None:
    filter, all_of_them = GmPhd(GmPhd.Config(expected_targets=4.0)), takes(seed=seed)
    state = given_state(filter, mixture(seed=seed))
    first = filter.update_together(state, all_of_them)
    assert first.components.count > 3
    for order in permutations(range(4)):
        other = filter.update_together(state, [all_of_them[s] for s in order])
        assert np.allclose(rows(other), rows(first), rtol=1e-9, atol=1e-9)
        assert np.allclose(other.undetected.values, first.undetected.values, rtol=1e-12)


def test_a_wide_component_follows_the_exact_corrector_on_a_fine_grid() -> None:
    one = Components(np.array([0.8]), np.array([[62.0, 71.0]]), np.array([[[0.6, 0.2], [0.2, 0.4]]]))
    some = takes(TARGETS[:, 1:2], seed=3, clutter=0.0)[:3]
    assert [len(t.measurements) for t in some].count(1) >= 2
    points, weights = on_grid(one, 161)
    looks = [t.sensor.look(points, t.pose, t.measurements) for t in some]
    exact = points_moments(points, jointly_corrected(weights, looks))
    filter = plain(gate_sigmas=6.0)
    after = filter.update_together(given_state(filter, one), some).components
    mean = after.weights @ after.means / after.weights.sum()
    assert after.weights.sum() == pytest.approx(exact[0], rel=5e-3)
    assert np.allclose(mean, exact[1], atol=0.02)


def test_one_sensor_is_the_ordinary_update_where_that_is_nearly_linear() -> None:
    filter, take = plain(), takes(seed=5)[2]
    narrow = mixture()
    state = given_state(filter, Components(narrow.weights, narrow.means, 0.02 * narrow.covariances))
    one = filter.update_together(state, [take]).components
    other = filter.update(
        state, take.sensor, take.pose, take.measurements, np.random.default_rng(0)
    ).components
    assert one.weights.sum() == pytest.approx(other.weights.sum(), rel=0.01)
    assert np.allclose(one.weights @ one.means, other.weights @ other.means, rtol=0.01)


def test_four_sensors_that_first_see_a_target_together_make_one_of_it() -> None:
    filter = GmPhd(GmPhd.Config(expected_targets=2.0))
    model, rng = sensor(gain=0.95, clutter=0.1, reach_m=[1e4] * 2), np.random.default_rng(1)
    z = [model.measure(TARGETS[:, :1], pose) + rng.normal(size=2) * model.sigmas for pose in POSES]
    state = filter.update_together(
        filter.init(AREA, rng), [Take(model, pose, one) for pose, one in zip(POSES, z, strict=True)]
    )
    _, clusters = filter.clusters(state, rng)
    assert clusters.masses[0] == pytest.approx(1.0, abs=0.05)
    assert np.linalg.norm(clusters.means[:, 0] - TARGETS[:, 0]) < 0.6
    places = [model.location_covariance(one, pose)[0] for pose, one in zip(POSES, z, strict=True)]
    fused = np.linalg.inv(sum(np.linalg.inv(p) for p in places))
    assert np.allclose(clusters.covariances[0], fused, atol=0.005)


def test_empty_sets_of_all_are_the_missed_detection_factors() -> None:
    filter = plain()
    models = [sensor(field_of_view="box", box_m=[(-1e4, 1e4)] * 2, gain=g) for g in (0.3, 0.5)]
    state = given_state(filter, mixture())
    after = filter.update_together(state, [Take(m, POSES[0], np.zeros((0, 2))) for m in models])
    assert np.allclose(np.sort(after.components.weights), np.sort(0.35 * state.components.weights))
    assert filter.update_together(state, []) is state


def test_what_is_no_input_is_named() -> None:
    filter = GmPhd(GmPhd.Config())
    state = filter.init(AREA, np.random.default_rng(0))
    with pytest.raises(ValueError, match="measurements"):
        filter.update_together(state, [Take(sensor(), POSES[0], np.full((1, 2), np.nan))])
    with pytest.raises(ValueError, match="pose"):
        filter.update_together(state, [Take(sensor(), np.ones(3), np.ones((1, 2)))])
