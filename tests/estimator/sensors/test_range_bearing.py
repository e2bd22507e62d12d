"""The range-bearing(-elevation) sensor against its formulas written out in numpy."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensors.range_bearing import GATE_SIGMAS, RangeBearing, wrapped


def sensor(d: int = 2, side: float = 60.0, **changes: Any) -> RangeBearing:
    config: dict[str, Any] = {
        "period_s": 1.0,
        "range_sigma_m": 0.5,
        "bearing_sigma_deg": 1.0,
        "elevation_sigma_deg": 1.5 if d == 3 else None,
        "reach_m": [20.0, 25.0, 30.0][:d],
        "gain": 0.9,
    }
    return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), Area(np.zeros(d), np.full(d, side)))


def dense(model: RangeBearing, points: FloatArray, pose: FloatArray, z: FloatArray) -> FloatArray:
    """The look's likelihoods as an (m, n) matrix."""
    look = model.look(points, pose, z)
    out = np.zeros((len(z), points.shape[1]))
    for j in range(len(z)):
        row = slice(look.offsets[j], look.offsets[j + 1])
        assert (out[j, look.indices[row]] == 0.0).all()
        assert (look.likelihood[row] > 0.0).all()
        out[j, look.indices[row]] = look.likelihood[row]
    return out


def explicit(model: RangeBearing, points: FloatArray, pose: FloatArray, z: FloatArray) -> FloatArray:
    """(10) with (6)-(9), 0 where a component is further off than the gate."""
    offset = points - pose[: len(points), None]
    level = np.hypot(offset[0], offset[1])
    columns = [level, np.arctan2(offset[1], offset[0]) - (pose[3] if model.body_frame else 0.0)]
    if len(points) == 3:
        columns = [np.sqrt((offset**2).sum(axis=0)), columns[1], np.arctan2(offset[2], level)]
    off = np.stack(columns, axis=1)[None] - z[:, None]
    off[..., 1] = wrapped(off[..., 1])
    g = np.prod(stats.norm.pdf(off, scale=model.sigmas), axis=-1)
    g[(np.abs(off) > GATE_SIGMAS * model.sigmas).any(axis=-1)] = 0.0
    return np.asarray(g)


@pytest.mark.parametrize("seed", range(40))
def test_look_agrees_with_the_formulas_for_all_kinds_of_noise_and_places(seed: int) -> None:
    rng = np.random.default_rng(seed)
    d = 2 + seed % 2
    model = sensor(
        d,
        range_sigma_m=0.5 * 10 ** rng.uniform(-1, 1),
        bearing_sigma_deg=10 ** rng.uniform(-1, 2.3),
        elevation_sigma_deg=10 ** rng.uniform(-1, 1.8) if d == 3 else None,
        bearing_frame="body" if seed % 3 == 0 else "world",
    )
    pose = np.append(rng.uniform(0, 60, 3), rng.uniform(-4, 4))
    points = rng.uniform(0, 60, (d, 1500))
    points[:, 0] = pose[:d]  # a particle on the sensor
    if d == 3:
        points[:2, 1:3] = pose[:2, None]  # exactly above and below
    z = np.concatenate([model.sample(points[:, :40], pose, rng), model.measure(points[:, :1], pose)])
    expected = explicit(model, points, pose, z)
    assert np.allclose(dense(model, points, pose, z), expected, rtol=1e-6, atol=1e-8 * expected.max())
    assert np.array_equal(model.look(points, pose, z).detection, model.detection(points, pose[None])[0])


@pytest.mark.parametrize("bearing", [np.pi, -np.pi, np.pi - 1e-3, -np.pi + 1e-3, 3 * np.pi])
def test_bearings_across_the_seam_are_near_each_other(bearing: float) -> None:
    model, pose = sensor(), np.array([30.0, 30.0, 0.0, 0.0])
    points = np.array([[20.0, 20.0, 20.0], [30.0, 30.01, 29.99]])
    z = np.array([[10.0, bearing]])
    assert (dense(model, points, pose, z) > 0.0).all()
    assert np.allclose(dense(model, points, pose, z), explicit(model, points, pose, z))


def test_body_bearings_turn_with_the_robot_and_world_bearings_do_not() -> None:
    target, pose = np.array([[10.0], [0.0]]), np.array([0.0, 0.0, 0.0, 0.5])
    assert sensor(bearing_frame="body").measure(target, pose)[0, 1] == pytest.approx(-0.5)
    assert sensor().measure(target, pose)[0, 1] == pytest.approx(0.0)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("frame", ["world", "body"])
def test_locate_is_the_inverse_of_measure(d: int, frame: str) -> None:
    model, rng = sensor(d, bearing_frame=frame), np.random.default_rng(4)
    targets, pose = rng.uniform(0, 60, (d, 50)), np.array([30.0, 20.0, 10.0, 2.0])
    assert np.allclose(model.locate(model.measure(targets, pose), pose), targets)


@pytest.mark.parametrize("d", [2, 3])
def test_location_covariance_is_that_of_many_noisy_locations(d: int) -> None:
    model, rng = sensor(d), np.random.default_rng(5)
    target, pose = np.array([[40.0], [50.0], [30.0]])[:d], np.array([10.0, 20.0, 10.0, 0.0])
    z = model.measure(target, pose)
    noisy = z + rng.standard_normal((40_000, d)) * model.sigmas
    sampled = np.cov(model.locate(noisy, pose))
    assert np.allclose(model.location_covariance(z, pose)[0], sampled, atol=0.03 * np.trace(sampled))


@pytest.mark.parametrize("d", [2, 3])
def test_a_target_on_the_sensor_has_a_finite_place_and_covariance(d: int) -> None:
    model, pose = sensor(d), np.array([10.0, 20.0, 30.0, 0.0])
    z = model.measure(pose[:d, None], pose)
    assert np.allclose(z, 0.0)
    assert np.allclose(model.locate(z, pose)[:, 0], pose[:d])
    assert (np.linalg.eigvalsh(model.location_covariance(z, pose)[0]) > 0.0).all()
    assert dense(model, pose[:d, None], pose, z)[0, 0] > 0.0


@pytest.mark.parametrize("d", [2, 3])
def test_samples_follow_detection_noise_and_clutter(d: int) -> None:
    model, rng = sensor(d, clutter=3.0), np.random.default_rng(6)
    target, pose = np.array([[35.0], [40.0], [20.0]])[:d], np.array([30.0, 30.0, 25.0, 1.0])
    exact, sets = model.measure(target, pose)[0], [model.sample(target, pose, rng) for _ in range(4000)]
    p = model.detection(target, pose[None])[0, 0]
    assert np.mean([len(z) for z in sets]) == pytest.approx(p + 3.0, abs=0.1)
    every = np.concatenate(sets)
    off = every - exact
    off[:, 1] = wrapped(off[:, 1])
    near = (np.abs(off) < 4 * model.sigmas).all(axis=1)
    assert near.sum() == pytest.approx(4000 * p, rel=0.06)
    assert np.allclose(off[near].std(axis=0), model.sigmas, rtol=0.05)
    false = every[~near]
    assert ((false >= model.clutter_low) & (false <= model.clutter_high)).all()
    middle = (model.clutter_low + model.clutter_high) / 2
    assert np.allclose((false > middle).mean(axis=0), 0.5, atol=0.02)


@pytest.mark.parametrize("d", [2, 3])
def test_clutter_intensity_integrates_to_the_expected_number(d: int) -> None:
    model, pose = sensor(d, clutter=2.5), np.array([30.0, 30.0, 25.0, 1.0])
    inside = (model.clutter_low + model.clutter_high)[None] / 2
    volume = np.prod(model.clutter_high - model.clutter_low)
    assert model.clutter_intensity(inside, pose)[0] * volume == pytest.approx(2.5)
    beyond = inside + np.eye(d)[:1] * 1e3
    assert model.clutter_intensity(beyond, pose)[0] == 0.0


def test_a_sectors_clutter_lies_in_the_sector_wherever_it_looks() -> None:
    for frame in ("world", "body"):
        model = sensor(
            field_of_view="sector",
            range_m=9.0,
            min_range_m=1.0,
            angle_deg=60.0,
            clutter=4.0,
            bearing_frame=frame,
        )
        pose, rng = np.array([5.0, 5.0, 0.0, 3.0]), np.random.default_rng(7)
        z = np.concatenate([model.sample(np.zeros((2, 0)), pose, rng) for _ in range(200)])
        assert (model.detection(model.locate(z, pose), pose)[0] > 0.0).all()
        assert (model.clutter_intensity(z, pose) > 0.0).all()
        outside = np.array([[5.0, z[0, 1] + np.pi]])
        assert model.clutter_intensity(outside, pose)[0] == 0.0


def test_no_measurements_and_no_points_give_an_empty_look() -> None:
    model, pose = sensor(), np.zeros(4)
    empty = model.look(np.zeros((2, 0)), pose, np.zeros((0, 2)))
    assert (empty.detection.size, empty.indices.size, empty.offsets.tolist()) == (0, 0, [0])
    one = model.look(np.zeros((2, 0)), pose, np.array([[5.0, 0.0]]))
    assert one.offsets.tolist() == [0, 0]


def test_a_range_below_zero_is_a_measurement_like_any_other() -> None:
    model, pose = sensor(), np.zeros(4)
    z, points = np.array([[-0.4, 0.0]]), np.array([[0.05, 0.5], [0.0, 0.0]])
    assert np.allclose(dense(model, points, pose, z), explicit(model, points, pose, z))
    assert np.allclose(model.locate(z, pose), 0.0)


GOOD = (np.zeros((2, 3)), np.zeros(4), np.ones((1, 2)))


@pytest.mark.parametrize(
    ("points", "pose", "z", "name"),
    [
        (np.zeros((3, 3)), *GOOD[1:], "points"),
        (np.full((2, 3), np.nan), *GOOD[1:], "points"),
        (np.full((2, 3), np.inf), *GOOD[1:], "points"),
        (GOOD[0], np.zeros(3), GOOD[2], "pose"),
        (GOOD[0], np.full(4, np.nan), GOOD[2], "pose"),
        (*GOOD[:2], np.ones((1, 3)), "measurements"),
        (*GOOD[:2], np.full((1, 2), np.inf), "measurements"),
    ],
)
def test_bad_input_is_refused_by_name(points: FloatArray, pose: FloatArray, z: FloatArray, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        sensor().look(points, pose, z)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"reach_m": [5.0, 5.0, 5.0]}, "reach_m"),
        ({"reach_m": None}, "reach_m"),
        ({"elevation_sigma_deg": 1.0}, "elevation_sigma_deg"),
        ({"field_of_view": "box"}, "box_m"),
        ({"field_of_view": "box", "box_m": [(1.0, -1.0), (0.0, 1.0)]}, "box_m"),
        ({"field_of_view": "sector", "angle_deg": 60.0}, "range_m"),
        ({"field_of_view": "sector", "range_m": 5.0}, "angle_deg"),
        ({"field_of_view": "sector", "range_m": 5.0, "angle_deg": 9.0, "min_range_m": 6.0}, "min_range_m"),
        ({"range_breaks_m": [1.0, 2.0], "range_gains": [1.0]}, "range_gains"),
        ({"range_breaks_m": [2.0, 1.0], "range_gains": [1.0, 1.0]}, "range_breaks_m"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_by_key(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(ValueError, match=key):
        sensor(**changes)


@pytest.mark.parametrize("seed", range(6))
def test_the_jacobian_is_the_slope_of_the_measurement(seed: int) -> None:
    rng = np.random.default_rng(seed)
    d = 2 + seed % 2
    model = sensor(d, bearing_frame="body" if seed % 3 == 0 else "world")
    pose = np.append(rng.uniform(20.0, 40.0, 3), rng.uniform(-3.0, 3.0))
    targets = rng.uniform(0.0, 60.0, (d, 50))
    slopes = model.jacobian(targets, pose)
    for a in range(d):
        step = np.zeros((d, 1))
        step[a] = 1e-5
        off = model.measure(targets + step, pose) - model.measure(targets - step, pose)
        off[:, 1] = wrapped(off[:, 1])
        np.testing.assert_allclose(slopes[:, :, a], off / 2e-5, atol=1e-6)


@pytest.mark.parametrize("d", [2, 3])
def test_the_jacobian_is_finite_on_the_sensor_and_above_it(d: int) -> None:
    pose = np.array([5.0, 5.0, 5.0, 0.3])
    targets = np.array([[5.0, 5.0], [5.0, 5.0], [5.0, 9.0]])[:d]
    assert np.isfinite(sensor(d).jacobian(targets, pose)).all()


@pytest.mark.parametrize("seed", range(12))
def test_a_look_at_its_own_measurement_says_what_a_look_at_all_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    d = 2 + seed % 2
    model = sensor(d, range_sigma_m=3.0, bearing_sigma_deg=10 ** rng.uniform(0.5, 2.0))
    pose = np.append(rng.uniform(20.0, 40.0, 3), rng.uniform(-3.0, 3.0))
    z = model.measure(rng.uniform(0.0, 60.0, (d, 4)), pose)
    points = rng.uniform(0.0, 60.0, (d, 3000))
    owners = rng.integers(0, 4, 3000)
    detection, likelihood = model.own_look(points, pose, z, owners)
    expected = dense(model, points, pose, z)[owners, np.arange(3000)]
    assert (expected > 0.0).any()
    np.testing.assert_allclose(likelihood, expected, rtol=1e-12)
    np.testing.assert_array_equal(detection, model.look(points, pose, z).detection)


def test_a_point_that_is_no_number_is_refused_by_its_own_look_too() -> None:
    points = np.array([[1.0, np.nan], [1.0, 1.0]])
    with pytest.raises(ValueError, match="points"):
        sensor().own_look(points, np.zeros(4), np.array([[1.0, 0.0]]), np.zeros(2, np.int64))
