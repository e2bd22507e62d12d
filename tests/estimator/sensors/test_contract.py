"""What every sensor model promises, whatever its kind: estimator.sensor.SensorModel checked from outside."""

from math import pi

import numpy as np
import pytest

from estimator.arrays import BoolArray, FloatArray
from estimator.sensor import GaussianSensor, SensorModel, gaussian
from estimator.sensors.bands import GATE_SIGMAS
from tests.estimator.sensors.cases import MODELS, NAMES, POSE, SIDE, Case, case
from tests.packaging.docs_tables import our_kinds

ALL = [case(name, d) for name in NAMES for d in (2, 3)]
GAUSSIAN = [c for c in ALL if not c.counted]
every = pytest.mark.parametrize("case", ALL, ids=lambda c: c.name)
every_gaussian = pytest.mark.parametrize("case", GAUSSIAN, ids=lambda c: c.name)


def points_around(
    sensor: SensorModel, count: int, rng: np.random.Generator, reach: float = 9.0
) -> FloatArray:
    """Points (d, n) on all sides of POSE, the first on the sensor, the second above it in 3D."""
    points = POSE[: sensor.dimension, None] + rng.uniform(-reach, reach, (sensor.dimension, count))
    points[:, 0] = POSE[: sensor.dimension]
    points[:2, 1] = POSE[:2]
    return points


def seen_well(sensor: SensorModel, rng: np.random.Generator) -> FloatArray:
    """One point (d, 1), some way off, where p_D is fair, also a metre further on every side."""
    d = sensor.dimension
    points = points_around(sensor, 1000, rng)
    steps = np.concatenate([np.zeros((d, 1)), np.eye(d), -np.eye(d)], axis=1)
    fair = np.hypot(*(points - POSE[:d, None])[:2]) > 2.0
    nearby = (points[:, :, None] + steps[:, None, :]).reshape(d, -1)
    detection = sensor.detection(nearby, POSE)[0].reshape(1000, -1).min(axis=1) * fair
    return points[:, [int(np.flatnonzero(detection >= 0.3 * detection.max())[2])]]


def dense(sensor: SensorModel, points: FloatArray, z: FloatArray) -> FloatArray:
    """p_D g (m, n) from a look."""
    look = sensor.look(points, POSE, z)
    assert look.offsets[0] == 0
    assert look.offsets[-1] == look.indices.size == look.likelihood.size
    assert (look.likelihood > 0.0).all()
    out = np.zeros((len(z), points.shape[1]))
    rows = np.repeat(np.arange(len(z)), np.diff(look.offsets))
    out[rows, look.indices] = look.likelihood
    assert np.count_nonzero(out) == look.indices.size  # no point twice in a row
    return np.asarray(out * look.detection)


def explicit(sensor: GaussianSensor, points: FloatArray, z: FloatArray) -> FloatArray:
    """p_D g (m, n) written out."""
    off = sensor.measure(points, POSE)[None] - z[:, None]
    off = np.where(sensor.angular, (off + pi) % (2 * pi) - pi, off)
    variance = np.diag(sensor.noise)
    density = np.exp(-0.5 * off**2 / variance) / np.sqrt(2 * pi * variance)
    density[np.abs(off) > GATE_SIGMAS * np.sqrt(variance)] = 0.0
    return np.asarray(density.prod(axis=-1) * sensor.detection(points, POSE)[0])


def around(case: Case, centre: FloatArray, sigmas: float = 6.5) -> tuple[FloatArray, float]:
    """A grid of measurements (k, s) around one, and the volume of each of its cells."""
    if case.counted:
        return case.anywhere(0, np.random.default_rng(0))[0], 1.0
    deviations = np.sqrt(np.diag(gaussian(case.sensor).noise))
    count = {1: 1000, 2: 100, 3: 40}[centre.size]
    axis = sigmas * ((2.0 * np.arange(count) + 1.0) / count - 1.0)
    grid = np.stack(np.meshgrid(*[axis] * centre.size, indexing="ij")).reshape(centre.size, -1).T
    return centre + grid * deviations, float(np.prod(deviations * (axis[1] - axis[0])))


def within_reach(case: Case, points: FloatArray) -> BoolArray:
    """Whether the case's table has targets at points (d, n) (n,), where its field of view has no end."""
    offset = points - POSE[: len(points), None]
    if case.kind == "bearing_only":
        return np.asarray((offset**2).sum(axis=0) <= case.sensor.reach**2)  # type: ignore[attr-defined]
    if not case.name.startswith("detector-kinds"):
        return np.ones(points.shape[1], dtype=np.bool_)
    c, s = np.cos(POSE[3]), np.sin(POSE[3])
    offset[:2] = np.array([[c, s], [-s, c]]) @ offset[:2]
    return np.asarray((np.abs(offset) <= 9.0).all(axis=0))


def same_count(found: float, expected: float) -> bool:
    """Whether a Poisson number is what was expected, with five standard deviations of room."""
    return abs(found - expected) <= 5.0 * np.sqrt(expected) + 3.0


REAL = {"mrclam", "udp_detections", "mavlink_detections"}  # they have the models of others


def test_every_kind_of_a_mission_is_under_this_contract() -> None:
    kinds = {kind for group, kind in our_kinds() if group == "sensors"}
    assert kinds - REAL == set(MODELS)


@every
def test_detection_is_a_probability_for_every_point_and_pose(case: Case) -> None:
    rng = np.random.default_rng(1)
    points = points_around(case.sensor, 500, rng, 30.0)
    poses = np.stack([POSE, POSE + 3.0, POSE * 0.0])
    detection = case.sensor.detection(points, poses)
    assert detection.shape == (3, 500)
    assert ((detection >= 0.0) & (detection <= 1.0)).all()
    assert np.ptp(detection) > 0.1
    for k in range(3):
        assert np.array_equal(detection[k], case.sensor.detection(points, poses[k])[0])
    assert np.array_equal(
        case.sensor.look(points, POSE, np.zeros((0, case.low.size))).detection, detection[0]
    )


@every
@pytest.mark.parametrize("seed", [1, 2])
def test_the_likelihood_of_a_target_integrates_to_one(case: Case, seed: int) -> None:
    target = seen_well(case.sensor, np.random.default_rng(seed))
    centre = np.ones(1) if case.counted else gaussian(case.sensor).measure(target, POSE)[0]
    z, cell = around(case, centre)
    look = case.sensor.look(target, POSE, z)
    assert look.likelihood.sum() * cell == pytest.approx(1.0, abs=1e-4)


@every
def test_clutter_integrates_to_the_expected_number(case: Case) -> None:
    z, volume = case.anywhere(40_000, np.random.default_rng(3))
    clutter = case.sensor.clutter_intensity(z, POSE)
    assert (clutter >= 0.0).all()
    rate = case.sensor.clutter  # type: ignore[attr-defined]
    assert clutter.mean() * volume == pytest.approx(rate, rel=0.03)
    points = points_around(case.sensor, 2, np.random.default_rng(0))
    assert np.array_equal(case.sensor.look(points, POSE, z[:50]).clutter, clutter[:50])


@every
def test_samples_without_targets_are_the_clutter(case: Case) -> None:
    rng, sensor, sets = np.random.default_rng(4), case.sensor, 800
    none = np.zeros((sensor.dimension, 0))
    drawn = [sensor.sample(none, POSE, rng) for _ in range(sets)]
    z = np.concatenate(drawn)
    rate = sensor.clutter  # type: ignore[attr-defined]
    counts = np.array([len(part) for part in drawn])
    assert same_count(len(z), sets * rate)
    assert counts.var() == pytest.approx(rate, rel=0.3)  # Poisson
    assert (sensor.clutter_intensity(z, POSE) > 0.0).all()
    even, volume = case.anywhere(40_000, rng)
    clutter = sensor.clutter_intensity(even, POSE) * (volume * sets / len(even))
    for a in range(z.shape[1]):
        edges = np.linspace(case.low[a] - 0.5, case.high[a] + 0.5, 14)
        expected, found = np.histogram(even[:, a], edges, weights=clutter)[0], np.histogram(z[:, a], edges)[0]
        assert (np.abs(found - expected) <= 5.0 * np.sqrt(expected) + 0.02 * expected + 3.0).all()


@every
@pytest.mark.parametrize("seed", [5])
def test_samples_of_a_target_follow_detection_noise_and_clutter(case: Case, seed: int) -> None:
    rng, sensor, sets = np.random.default_rng(seed), case.sensor, 800
    target = seen_well(sensor, rng)
    drawn = np.concatenate([sensor.sample(target, POSE, rng) for _ in range(sets)])
    if case.counted:
        z = case.anywhere(0, rng)[0]
        expected = sets * (dense(sensor, target, z)[:, 0] + sensor.clutter_intensity(z, POSE))
        found = (drawn == z.T).sum(axis=0)
        assert found.sum() == len(drawn)
        assert (np.abs(found - expected) <= 5.0 * np.sqrt(expected) + 3.0).all()
        return
    model = gaussian(sensor)
    centre, scale = model.measure(target, POSE)[0], np.sqrt(np.diag(model.noise))
    z, cell = around(case, centre, 4.0)
    counts = (dense(sensor, target, z)[:, 0] + sensor.clutter_intensity(z, POSE)) * cell * sets
    off = drawn - centre
    off = np.where(model.angular, (off + pi) % (2 * pi) - pi, off) / scale
    off = off[(np.abs(off) < 4.0).all(axis=1)]
    edges = np.array([-4.0, -1.6, -0.8, 0.0, 0.8, 1.6, 4.0])  # between cells of the grid
    for a in range(centre.size):
        expected = np.histogram(((z - centre) / scale)[:, a], edges, weights=counts)[0]
        found = np.histogram(off[:, a], edges)[0]
        assert (np.abs(found - expected) <= 5.0 * np.sqrt(expected) + 3.0).all()


@every_gaussian
@pytest.mark.parametrize("seed", [7, 8])
def test_a_look_gives_what_the_formula_without_gates_gives(case: Case, seed: int) -> None:
    rng, sensor = np.random.default_rng(seed), gaussian(case.sensor)
    points = points_around(sensor, 1500, rng)
    z = np.concatenate([sensor.sample(points[:, :30], POSE, rng), sensor.measure(points[:, :8], POSE)])
    z[0, np.flatnonzero(sensor.angular)[:1]] += 2 * pi
    expected = explicit(sensor, points, z)
    assert (expected > 0.0).any(axis=1).sum() > 5
    np.testing.assert_allclose(dense(sensor, points, z), expected, rtol=1e-6, atol=1e-8 * expected.max())


@pytest.mark.parametrize("case", [c for c in ALL if c.counted], ids=lambda c: c.name)
def test_a_look_at_categories_is_the_softmax(case: Case) -> None:
    sensor = case.sensor
    points = points_around(sensor, 500, np.random.default_rng(7))
    turned = sensor.softmax.placed(POSE).probabilities(points)  # type: ignore[attr-defined]
    z = np.arange(1.0, case.high[0] + 1.0)[:, None]
    np.testing.assert_allclose(dense(sensor, points, z), 0.9 * turned[1:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(sensor.detection(points, POSE)[0], 0.9 * (1.0 - turned[0]), atol=1e-9)


@every
@pytest.mark.parametrize("seed", [9, 10])
def test_locate_is_where_a_target_would_be_that_could_be_anywhere(case: Case, seed: int) -> None:
    rng, sensor = np.random.default_rng(seed), case.sensor
    target = seen_well(sensor, rng)
    z = np.full((1, 1), 1.0 + seed % case.high[0]) if case.counted else gaussian(sensor).measure(target, POSE)
    place, spread = sensor.locate(z, POSE)[:, 0], sensor.location_covariance(z, POSE)[0]
    assert np.allclose(spread, spread.T)
    assert (np.linalg.eigvalsh(spread) > 0.0).all()
    # twice as wide as what it should be, so that a place that is wrong or too narrow shows
    half = 4.0 * np.sqrt(np.diag(spread))
    points = place[:, None] + rng.uniform(-half[:, None], half[:, None], (sensor.dimension, 60_000))
    points = points[:, within_reach(case, points)]
    weights = dense(sensor, np.ascontiguousarray(points), z)[0]
    mean = np.average(points, axis=1, weights=weights)
    found = np.cov(points, aweights=weights)
    size = np.trace(found)
    assert np.linalg.norm(mean - place) < 0.2 * np.sqrt(size)
    assert np.abs(found - spread).max() < 0.2 * size


@every_gaussian
@pytest.mark.parametrize("seed", [12, 13])
def test_the_jacobian_is_the_slope_of_the_measurement(case: Case, seed: int) -> None:
    sensor = gaussian(case.sensor)
    targets = points_around(sensor, 60, np.random.default_rng(seed))
    slopes = sensor.jacobian(targets, POSE)
    assert slopes.shape == (60, sensor.measurement_size, sensor.dimension)
    assert np.isfinite(slopes).all()  # also on the sensor and above it
    for a in range(sensor.dimension):
        step = 1e-5 * np.eye(sensor.dimension)[:, [a]]
        off = sensor.measure(targets + step, POSE) - sensor.measure(targets - step, POSE)
        off = np.where(sensor.angular, (off + pi) % (2 * pi) - pi, off)
        np.testing.assert_allclose(slopes[2:, :, a], off[2:] / 2e-5, atol=1e-4)
    assert sensor.noise.shape == (sensor.measurement_size, sensor.measurement_size)
    assert sensor.angular.shape == (sensor.measurement_size,)


@pytest.mark.parametrize("case", [c for c in ALL if c.counted], ids=lambda c: c.name)
def test_a_detector_is_no_gaussian_sensor_and_says_what_to_use(case: Case) -> None:
    with pytest.raises(ValueError, match="particle filter"):
        gaussian(case.sensor)


@every
@pytest.mark.parametrize("angle", [0.0, 1.1, -2.9])
def test_what_a_sensor_says_moves_and_turns_with_the_frame(case: Case, angle: float) -> None:
    if angle != 0.0 and not case.turns:
        pytest.skip("the field of view keeps to the axes of the world")
    sensor, rng = case.sensor, np.random.default_rng(14)
    d = sensor.dimension
    c, s, turn = np.cos(angle), np.sin(angle), np.eye(d)
    turn[:2, :2] = [[c, -s], [s, c]]
    shift = np.array([3.0, -7.0, 2.0])
    pose = np.concatenate([turn[:2, :2] @ POSE[:2], POSE[2:]]) + np.append(shift, angle)
    points = points_around(sensor, 400, rng)[:, 2:]  # on the sensor a bearing is a convention
    moved = np.ascontiguousarray(turn @ points + shift[:d, None])
    z = sensor.sample(points[:, :40], POSE, rng)
    turned = z.copy()
    if case.frame == "world":
        turned[:, int(case.kind == "range_bearing")] += angle
    elif case.frame == "map":
        turned = z @ turn.T + shift[:d]
    before, after = sensor.look(points, POSE, z), sensor.look(moved, pose, turned)
    near = np.isclose(after.detection, before.detection, atol=1e-6)
    assert near.mean() > 0.99  # rounding may put a point on the other side of an edge
    for j in range(len(z)):
        one, two = np.zeros((2, points.shape[1]))
        for out, look in ((one, before), (two, after)):
            row = slice(look.offsets[j], look.offsets[j + 1])
            out[look.indices[row]] = look.likelihood[row]
        np.testing.assert_allclose(two[near], one[near], rtol=1e-5, atol=1e-7 * (1.0 + one.max()))
    np.testing.assert_allclose(
        sensor.locate(turned, pose), turn @ sensor.locate(z, POSE) + shift[:d, None], atol=1e-3 * SIDE
    )
    spread = turn @ sensor.location_covariance(z, POSE) @ turn.T
    np.testing.assert_allclose(sensor.location_covariance(turned, pose), spread, atol=2e-2 * spread.max())
    if case.name.split("-")[1] != "smooth" or case.kind != "position":  # whose clutter lies in the area
        np.testing.assert_allclose(after.clutter, before.clutter, atol=1e-9)


@every
def test_nothing_measured_and_nobody_there_are_empty_and_not_wrong(case: Case) -> None:
    sensor, none = case.sensor, np.zeros((0, case.low.size))
    d = sensor.dimension
    empty = sensor.look(np.zeros((d, 0)), POSE, none)
    assert (empty.detection.size, empty.indices.size, empty.offsets.tolist()) == (0, 0, [0])
    points = points_around(sensor, 5, np.random.default_rng(0))
    assert sensor.look(points, POSE, none).offsets.tolist() == [0]
    assert sensor.look(np.zeros((d, 0)), POSE, np.ones((2, case.low.size))).offsets.tolist() == [0, 0, 0]
    assert sensor.locate(none, POSE).shape == (d, 0)
    assert sensor.location_covariance(none, POSE).shape == (0, d, d)
    assert sensor.clutter_intensity(none, POSE).shape == (0,)
    assert sensor.detection(np.zeros((d, 0)), POSE).shape == (1, 0)


@every
def test_odd_measurements_have_finite_places_and_no_likelihood_that_is_not_a_number(case: Case) -> None:
    sensor, s = case.sensor, case.low.size
    z = np.concatenate([np.full((1, s), x) for x in (-1e9, -4.0, -0.5, 0.0, pi, -pi, 1.5, 40.0, 1e12)])
    points = points_around(sensor, 200, np.random.default_rng(15))
    look = sensor.look(points, POSE, z)
    assert np.isfinite(look.likelihood).all()
    assert np.isfinite(look.clutter).all()
    assert np.isfinite(sensor.locate(z, POSE)).all()
    assert np.isfinite(sensor.location_covariance(z, POSE)).all()


@every
def test_very_many_measurements_are_no_matter(case: Case) -> None:
    sensor, rng = case.sensor, np.random.default_rng(16)
    z = rng.uniform(case.low, case.high, (5_000, case.low.size))
    points = points_around(sensor, 4, rng)
    look = sensor.look(points, POSE, z)
    assert look.offsets.shape == (5_001,)
    assert np.isfinite(sensor.location_covariance(z, POSE)).all()


@every
def test_samples_are_a_function_of_the_generator(case: Case) -> None:
    targets = points_around(case.sensor, 20, np.random.default_rng(17))
    one, two = (case.sensor.sample(targets, POSE, np.random.default_rng(18)) for _ in range(2))
    assert np.array_equal(one, two)
    assert one.flags.c_contiguous
    assert one.shape == (len(one), case.low.size)


@every
def test_the_outline_is_a_closed_line_around_the_robot_or_before_it(case: Case) -> None:
    outline = case.sensor.outline(POSE)
    assert outline.shape == (len(outline), 3)
    assert np.allclose(outline[0], outline[-1])
    assert np.ptp(outline[:, :2], axis=0).min() > 1.0


@every
@pytest.mark.parametrize(
    "fault", ["points", "points: every", "pose", "pose: every", "measurements", "measurements: every"]
)
def test_bad_input_is_refused_by_name(case: Case, fault: str) -> None:
    d, s = case.sensor.dimension, case.low.size
    points, pose, z = np.zeros((d, 3)), POSE.copy(), np.ones((1, s))
    name, _, every = fault.partition(":")
    if name == "points":
        points = np.full((d, 3), np.nan) if every else np.zeros((d + 1, 3))
    elif name == "pose":
        pose = np.full(4, np.inf) if every else np.zeros(3)
    else:
        z = np.full((1, s), np.nan) if every else np.ones((1, s + 1))
    with pytest.raises(ValueError, match=f"^{name}: {'every' if every else 'expected'}"):
        case.sensor.look(points, pose, z)
    if name != "points":
        with pytest.raises(ValueError, match=f"^{name}: "):
            case.sensor.locate(z, pose)
