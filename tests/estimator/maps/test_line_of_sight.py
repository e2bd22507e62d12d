"""Behind walls nothing is detected, by any sensor, in any use of its model."""

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.maps.line_of_sight import LineOfSight
from estimator.maps.occupancy import OCCUPIED, OccupancyMap
from estimator.maps.sight import Sight
from estimator.search import Search
from estimator.sensor import gaussian
from estimator.sensors.known import WithKnown, bare
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd

POSE = np.array([2.0, 10.0, 1.0, 0.0])


def ground() -> OccupancyMap:
    """20 m x 20 m; a wall from south to north at x = 10..10.5, open from y = 15 on."""
    cells = np.zeros((40, 40), np.uint8)
    cells[:30, 20] = OCCUPIED
    return OccupancyMap(cells, 0.5, np.zeros(3))


def sensors(d: int = 2, shape: str = "exponential") -> tuple[RangeBearing, LineOfSight]:
    config = RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=0.2,
        bearing_sigma_deg=1.0,
        elevation_sigma_deg=1.0 if d == 3 else None,
        gain=0.9,
        clutter=0.5,
        field_of_view=shape,  # type: ignore[arg-type]
        reach_m=[20.0] * d,
        range_m=14.0,
        angle_deg=100.0,
    )
    plain = RangeBearing.of(config, Area(np.zeros(d), np.full(d, 20.0)))
    return plain, LineOfSight(plain, Sight.of(ground()))


def scattered(d: int, n: int = 300) -> FloatArray:
    return np.random.default_rng(d).uniform(0.0, 20.0, (d, n))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("shape", ["exponential", "sector"])
def test_detection_is_the_sensors_own_or_zero_behind_walls(d: int, shape: str) -> None:
    plain, walled = sensors(d, shape)
    points = scattered(d)
    poses = np.array([POSE, [10.2, 18.0, 1.0, -1.5], [10.2, 5.0, 1.0, 0.0]])
    expected = plain.detection(points, poses) * walled.sight.visible(points, poses)
    np.testing.assert_array_equal(walled.detection(points, poses), expected)
    assert 0 < np.count_nonzero(expected[0]) < np.count_nonzero(plain.detection(points, poses)[0])


@pytest.mark.parametrize("d", [2, 3])
def test_a_look_agrees_with_detection_and_gives_the_hidden_no_likelihood(d: int) -> None:
    plain, walled = sensors(d)
    points = scattered(d)
    measurements = plain.measure(points[:, :40], POSE)
    look, own = walled.look(points, POSE, measurements), plain.look(points, POSE, measurements)
    np.testing.assert_array_equal(look.detection, walled.detection(points, POSE[None])[0])
    hidden = (look.detection == 0.0)[look.indices]
    assert 0 < hidden.sum() < hidden.size
    np.testing.assert_array_equal(look.likelihood, np.where(hidden, 0.0, own.likelihood))
    np.testing.assert_array_equal(look.clutter, own.clutter)


def test_without_a_wall_in_between_nothing_changes() -> None:
    plain, walled = sensors()
    points = scattered(2)
    points[0] *= 0.49
    measurements = plain.measure(points[:, :9], POSE)
    mine, own = walled.look(points, POSE, measurements), plain.look(points, POSE, measurements)
    for name in ("detection", "offsets", "indices", "likelihood", "clutter"):
        np.testing.assert_array_equal(getattr(mine, name), getattr(own, name))
    a, b = (s.sample(points, POSE, np.random.default_rng(1)) for s in (walled, plain))
    np.testing.assert_array_equal(a, b)


def test_hidden_targets_are_never_in_a_sample() -> None:
    _, walled = sensors()
    targets = np.array([[5.0, 15.0], [10.0, 10.0]])
    rng = np.random.default_rng(0)
    near = far = 0
    for _ in range(300):
        ranges = walled.sample(targets, POSE, rng)[:, 0]
        near += np.count_nonzero(abs(ranges - 3.0) < 0.8)
        far += np.count_nonzero(abs(ranges - 13.0) < 0.8)
    assert near > 200
    assert far < 30  # clutter: 0.5 a set over 28 m


def test_everything_else_is_the_sensors_own() -> None:
    plain, walled = sensors()
    z = np.array([[3.0, 0.1], [12.0, -0.4]])
    points = scattered(2, 5)
    np.testing.assert_array_equal(walled.locate(z, POSE), plain.locate(z, POSE))
    np.testing.assert_array_equal(walled.location_covariance(z, POSE), plain.location_covariance(z, POSE))
    np.testing.assert_array_equal(walled.clutter_intensity(z, POSE), plain.clutter_intensity(z, POSE))
    kalman = gaussian(walled)
    np.testing.assert_array_equal(kalman.noise, plain.noise)
    np.testing.assert_array_equal(kalman.angular, plain.angular)
    np.testing.assert_array_equal(kalman.measure(points, POSE), plain.measure(points, POSE))
    np.testing.assert_array_equal(kalman.jacobian(points, POSE), plain.jacobian(points, POSE))
    assert (walled.dimension, walled.measurement_size) == (2, 2)


class NoJacobian:
    """A sensor without Gaussian noise."""


def test_a_sensor_without_a_jacobian_does_not_get_one_from_being_wrapped() -> None:
    _, walled = sensors()
    with pytest.raises(ValueError, match="NoJacobian has none"):
        gaussian(LineOfSight(NoJacobian(), walled.sight))  # type: ignore[arg-type]
    none = np.zeros((2, 0))
    assert gaussian(WithKnown(walled, none, np.zeros(0), np.zeros(0))).noise.shape == (2, 2)


def test_known_objects_behind_a_wall_explain_nothing() -> None:
    plain, walled = sensors()
    places, spread, rates = np.array([[5.0, 15.0], [10.0, 10.0]]), np.full(2, 0.05), np.ones(2)
    z = np.array([[3.0, 0.0], [13.0, 0.0]])
    expected = WithKnown(walled, places, spread, rates)
    gained = expected.clutter_intensity(z, POSE) - plain.clutter_intensity(z, POSE)
    assert gained[0] > 1.0
    assert gained[1] == 0.0
    assert bare(expected) is walled


@pytest.mark.parametrize("shape", ["exponential", "sector"])
def test_the_outline_ends_at_walls(shape: str) -> None:
    plain, walled = sensors(2, shape)
    outline = walled.outline(POSE)
    np.testing.assert_allclose(outline[0], outline[-1], atol=1e-12)
    assert walled.sight.visible(outline[:, :2].T * 0.999 + POSE[:2, None] * 0.001, POSE).all()
    eastward = outline[abs(np.arctan2(outline[:, 1] - 10.0, outline[:, 0] - 2.0)) < 0.3]
    assert eastward[:, 0].max() == pytest.approx(10.0, abs=0.01)
    assert outline[:, 0].min() == pytest.approx(plain.outline(POSE)[:, 0].min())


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_points_that_are_nowhere_are_refused(bad: float) -> None:
    _, walled = sensors()
    points = np.array([[bad, 1.0], [1.0, 1.0]])
    with pytest.raises(ValueError, match="points"):
        walled.look(points, POSE, np.zeros((0, 2)))
    if np.isinf(bad):  # p_D of nowhere is 0 where that makes sense, so nothing is looked at
        with pytest.raises(ValueError, match="points"):
            walled.detection(points, POSE[None])


def test_a_search_learns_nothing_about_what_walls_hide() -> None:
    _, walled = sensors()
    area = Area(np.zeros(2), np.full(2, 20.0), ground())
    search = Search(SmcPhd(SmcPhd.Config(grid_points=[41, 41])), area, [41, 41], radius=1, mass=0.8, gate=4)
    rng = np.random.default_rng(0)
    state = search.init(rng)
    start = state.exploration
    assert search.expected_cardinality(state) == pytest.approx(1.0)
    nodes = start.nodes()
    free = area.is_free(nodes)
    np.testing.assert_array_equal(start.values.ravel(), free)
    for k in range(5):
        state = search.apply(state, walled, POSE, np.zeros((0, 2)), float(k), rng)
    hidden = ~walled.sight.visible(nodes, POSE)[0]
    np.testing.assert_array_equal(state.exploration.values.ravel()[hidden], free[hidden])
    assert (state.exploration.values.ravel()[free & ~hidden] < 0.6).all()
