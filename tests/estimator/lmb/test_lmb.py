"""The LMB filter against closed forms, the enumeration of all hypotheses, and Stone Soup's JPDA."""

from dataclasses import replace
from datetime import datetime
from itertools import product
from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.lmb.association import Pairs, associated
from estimator.lmb.lmb import Lmb, LmbState
from estimator.lmb.tracks import Tracks
from estimator.motion import MotionConfig
from estimator.newly_detected import explanations
from estimator.sensors.position import Position
from estimator.sensors.range_bearing import RangeBearing

AREA = Area(np.zeros(2), np.full(2, 100.0))
POSE = np.array([50.0, 50.0, 5.0, 0.0])
SIGMA = 0.5


def linear(gain: float = 0.9, clutter: float = 2.0) -> Position:
    """p_D, noise and clutter the same everywhere: what closed forms want."""
    config = Position.Config(
        period_s=1.0, sigma_m=SIGMA, gain=gain, clutter=clutter, box_m=[(-50.0, 50.0)] * 2
    )
    return Position.of(config, AREA)


def radar(**changes: Any) -> RangeBearing:
    config = {
        "period_s": 1.0,
        "range_sigma_m": 0.3,
        "bearing_sigma_deg": 0.5,
        "gain": 0.9,
        "clutter": 2.0,
        "field_of_view": "box",
        "box_m": [(-1e3, 1e3)] * 2,
    }
    return RangeBearing.of(RangeBearing.Config(**{**config, **changes}), AREA)


def lmb(**keys: Any) -> Lmb:
    plain = {"track_merging": 0.0, "component_merging": 0.0, "component_least": 1e-12, "components": 1000}
    return Lmb(Lmb.Config(**{**plain, "least_existence": 1e-9, "gate_sigmas": 9.0, **keys}))


def state_of(filter: Lmb, places: FloatArray, existence: list[float], spread: float = 1.0) -> LmbState:
    """Tracks of one isotropic Gaussian each at places (d, n)."""
    n, size = places.shape[1], 4 if filter.config.motion.kind == "constant_velocity" else 2
    means = np.zeros((n, size))
    means[:, :2] = places.T
    covariances = np.tile(spread**2 * np.eye(size), (n, 1, 1))
    tracks = Tracks.single(np.arange(n), np.array(existence), means, covariances)
    return replace(filter.init(AREA, np.random.default_rng(0)), tracks=tracks, next_label=n)


def test_one_certain_target_without_clutter_is_a_kalman_filter() -> None:
    motion = MotionConfig(kind="constant_velocity", acceleration=0.3)
    filter, rng = lmb(expected_targets=0.0, motion=motion), np.random.default_rng(3)
    sensor = linear(gain=1.0, clutter=0.0)
    state = state_of(filter, np.array([[20.0], [30.0]]), [0.7])
    x, p = state.tracks.components.means[0], state.tracks.components.covariances[0]
    h = np.eye(2, 4)
    for _ in range(12):
        z = x[:2] + rng.standard_normal(2)
        t, q = 0.5, 0.3**2
        f = np.kron([[1.0, t], [0.0, 1.0]], np.eye(2))
        noise = q * np.kron([[t**3 / 3, t**2 / 2], [t**2 / 2, t]], np.eye(2))
        x, p = f @ x, f @ p @ f.T + noise
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + SIGMA**2 * np.eye(2))
        x, p = x + gain @ (z - h @ x), p - gain @ h @ p
        state = filter.update(filter.predict(state, t, rng), sensor, POSE, z[None, :], rng)
        assert state.tracks.count == 1
        assert np.allclose(state.tracks.components.means[0], x, atol=1e-9)
        assert np.allclose(state.tracks.components.covariances[0], p, atol=1e-9)
    assert state.tracks.existence[0] == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("r", [0.001, 0.3, 0.9, 0.999])
def test_an_empty_set_leaves_the_bernoulli_factor_and_the_rest_of_the_undetected(r: float) -> None:
    filter, rng = lmb(expected_targets=3.0), np.random.default_rng(0)
    state = state_of(filter, np.array([[20.0], [30.0]]), [r])
    after = filter.update(state, linear(gain=0.8), POSE, np.zeros((0, 2)), rng)
    assert after.tracks.existence[0] == pytest.approx(r * 0.2 / (1.0 - 0.8 * r))
    assert np.allclose(after.tracks.components.means, state.tracks.components.means)
    assert after.undetected.mass() == pytest.approx(0.2 * 3.0)


def hypotheses(state: LmbState, sensor: Position, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Posterior r (n,), mean (n, 2) of each track and r (m,) of each new one, by summing over everything that
    can have happened: each track absent, unseen or seen as some measurement, the others clutter or new."""
    tracks, p_d = state.tracks, 0.9
    n, m = tracks.count, len(z)
    density = sensor.clutter / 100.0**2
    new = explanations(state.undetected, sensor, POSE, z).totals  # near p_D v_n: here all of g lies inside
    assert np.allclose(new, p_d * state.undetected.mass() / 100.0**2, rtol=0.02)
    covariance = tracks.components.covariances[0] + SIGMA**2 * np.eye(2)
    gain = tracks.components.covariances[0] @ np.linalg.inv(covariance)
    total, r, means, born = 0.0, np.zeros(n), np.zeros((n, 2)), np.zeros(m)
    for choice in product(range(-2, m), repeat=n):  # -2 absent, -1 there and unseen
        seen = [j for j in choice if j >= 0]
        if len(seen) != len(set(seen)):
            continue
        rest = [j for j in range(m) if j not in seen]
        for news in product((False, True), repeat=len(rest)):
            weight = float(np.prod([new[j] if n else density for j, n in zip(rest, news, strict=True)]))
            places = np.array(tracks.components.means)
            for i, j in enumerate(choice):
                exists = tracks.existence[i]
                if j == -2:
                    weight *= 1.0 - exists
                    continue
                weight *= exists * (1.0 - p_d if j == -1 else p_d)
                if j >= 0:
                    step = z[j] - places[i]
                    weight *= float(np.exp(-0.5 * step @ np.linalg.solve(covariance, step)))
                    weight /= 2.0 * np.pi * np.sqrt(np.linalg.det(covariance))
                    places[i] += gain @ step
            total += weight
            there = np.array(choice) >= -1
            r += weight * there
            means[there] += weight * places[there]
            for j, is_new in zip(rest, news, strict=True):
                born[j] += weight * is_new
    return r / total, means / r[:, None], born / total


@pytest.mark.parametrize("seed", range(8))
def test_an_update_sums_over_everything_that_can_have_happened(seed: int) -> None:
    rng = np.random.default_rng(seed)
    filter, sensor = lmb(expected_targets=2.0), linear()
    places = 50.0 + rng.uniform(-2.0, 2.0, (2, 3))
    state = state_of(filter, places, rng.uniform(0.1, 0.95, 3).tolist())
    z = 50.0 + rng.uniform(-3.0, 3.0, (3, 2))
    after = filter.update(state, sensor, POSE, z, rng)
    r, means, born = hypotheses(state, sensor, z)
    assert np.allclose(after.tracks.existence[:3], r, atol=1e-6)
    assert np.allclose(after.tracks.moments(2)[0][:3], means, atol=1e-5)
    assert np.allclose(after.tracks.existence[3:], born, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_association_probabilities_are_stone_soups_jpda(seed: int) -> None:
    """Tracks that are certain to exist, clutter of one density: there LMB's marginals are those of JPDA."""
    from stonesoup.dataassociator.probability import JPDA
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater

    rng, when = np.random.default_rng(seed), datetime(2024, 1, 1)
    places, z = rng.uniform(0.0, 3.0, (3, 2)), rng.uniform(0.0, 3.0, (4, 2))
    p_d, density, spread = 0.8, 0.1, 0.6
    model = LinearGaussian(ndim_state=2, mapping=(0, 1), noise_covar=SIGMA**2 * np.eye(2))
    still = KalmanPredictor(CombinedLinearGaussianTransitionModel([RandomWalk(0.0), RandomWalk(0.0)]))
    hypothesiser = PDAHypothesiser(
        still,
        KalmanUpdater(model),
        clutter_spatial_density=density,
        prob_detect=p_d,
        prob_gate=1 - 1e-12,
        include_all=True,
    )
    tracks = [Track([GaussianState(StateVector(x), spread**2 * np.eye(2), timestamp=when)]) for x in places]
    detections = [Detection(StateVector(x), timestamp=when, measurement_model=model) for x in z]
    theirs = np.zeros((3, 5))
    for track, multiple in JPDA(hypothesiser).associate(tracks, detections, when).items():
        i = tracks.index(track)
        for hypothesis in multiple:
            j = detections.index(hypothesis.measurement) + 1 if hypothesis else 0
            theirs[i, j] = float(hypothesis.probability)
    variance = spread**2 + SIGMA**2
    squares = ((places[:, None] - z[None]) ** 2).sum(axis=2)
    likelihood = np.exp(-0.5 * squares / variance) / (2.0 * np.pi * variance)
    psi = (p_d * likelihood / ((1.0 - p_d) * density)).ravel()
    ours = associated(Pairs(np.arange(0, 13, 4), np.tile(np.arange(4), 3), psi, 4))
    assert np.allclose(ours.pairs.reshape(3, 4), theirs[:, 1:], atol=1e-6)
    assert np.allclose(ours.unseen, theirs[:, 0], atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_without_clutter_and_misses_every_measurement_has_its_target(seed: int) -> None:
    """Mass balance: p_D = 1 and no clutter leave one target for each measurement, and nothing else."""
    rng = np.random.default_rng(seed)
    filter = lmb(expected_targets=2.0)
    state = state_of(filter, 50.0 + rng.uniform(-3.0, 3.0, (2, 4)), [0.2, 0.5, 0.7, 0.9])
    z = 50.0 + rng.uniform(-3.0, 3.0, (5, 2))
    after = filter.update(state, linear(gain=1.0, clutter=0.0), POSE, z, rng)
    assert filter.mass(after) == pytest.approx(5.0, abs=1e-4)


def test_turning_and_moving_the_world_turns_and_moves_the_estimate() -> None:
    """A quarter turn about the area's centre, which leaves the area as it is."""
    filter, rng, sensor = lmb(expected_targets=2.0), np.random.default_rng(1), radar(clutter=0.5)
    centre, turn = np.full((2, 1), 50.0), np.array([[0.0, -1.0], [1.0, 0.0]])
    targets = np.array([[30.0, 32.0, 70.0], [40.0, 41.0, 20.0]])
    results = []
    for rotation, yaw in ((np.eye(2), 0.0), (turn, 0.5 * np.pi)):
        rng = np.random.default_rng(1)
        state = filter.init(AREA, rng)
        for k in range(6):
            place = rotation @ (np.array([[45.0 + k], [55.0]]) - centre) + centre
            pose = np.array([*place[:, 0], 5.0, yaw])
            z = sensor.measure(targets, np.array([45.0 + k, 55.0, 5.0, 0.0]))
            z = z + sensor.sigmas * rng.standard_normal(z.shape)
            z[:, 1] += yaw
            state = filter.update(state, sensor, pose, z, rng)
        means, _ = state.tracks.moments(2)
        results.append((state.tracks.existence, rotation.T @ (means.T - centre)))
    assert np.allclose(results[0][0], results[1][0], atol=1e-6)
    assert np.allclose(results[0][1], results[1][1], atol=1e-6)


def followed(association: str, seed: int, targets: FloatArray, looks: int, **keys: Any) -> LmbState:
    filter = Lmb(Lmb.Config(expected_targets=3.0, association=association, **keys))  # type: ignore[arg-type]
    rng, sensor = np.random.default_rng(seed), radar()
    state = filter.init(AREA, rng)
    for k in range(looks):
        pose = np.array([50.0 + 20.0 * np.cos(0.4 * k), 50.0 + 20.0 * np.sin(0.4 * k), 5.0, 0.0])
        state = filter.predict(state, 1.0, rng)
        state = filter.update(state, sensor, pose, sensor.sample(targets, pose, rng), rng)
        state, _ = filter.clusters(state, rng)
    return state


@pytest.mark.parametrize("association", ["lbp", "gibbs"])
@pytest.mark.parametrize("seed", range(2))
def test_targets_near_each_other_are_told_apart(association: str, seed: int) -> None:
    """Half a metre, about one and a half of the noise: as the landmarks of MRCLAM stand."""
    targets = np.array([[40.0, 40.5, 40.2, 70.0], [45.0, 45.0, 45.45, 30.0]])
    state = followed(association, seed, targets, 60, exact_groups=0 if association == "gibbs" else 5)
    likely = state.tracks.existence > 0.5
    means = state.tracks.moments(2)[0][likely].T
    assert likely.sum() == 4
    gaps = np.linalg.norm(means[:, :, None] - targets[:, None, :], axis=0)
    assert (gaps.min(axis=0) < 0.25).all()


def test_trajectories_hold_where_each_label_was() -> None:
    from estimator.lmb.trajectories import trajectories

    targets = np.array([[40.0, 70.0], [45.0, 30.0]])
    state = followed("lbp", 0, targets, 30, remembered=20)
    assert len(state.history) == 20
    paths = trajectories(state.history)
    labels = state.tracks.labels[state.tracks.existence > 0.5].tolist()
    assert len(labels) == 2
    for label in labels:
        assert paths[label].times.tolist() == [float(t) for t in range(11, 31)]
        assert paths[label].means.shape == (2, 20)
        assert np.linalg.norm(paths[label].means[:, -1:] - targets, axis=0).min() < 0.3


def crossed(seed: int) -> bool:
    """Whether two targets that cross at 40 degrees have the labels afterwards that they had before."""
    motion = MotionConfig(kind="constant_velocity", acceleration=0.1, speed=2.0)
    filter = Lmb(Lmb.Config(expected_targets=2.0, motion=motion, survival=0.999))
    rng, sensor = np.random.default_rng(seed), radar(clutter=5.0)
    starts, speeds = np.array([[20.0, 20.0], [40.0, 60.0]]), np.array([[1.4, 1.4], [0.5, -0.5]])
    state, names = filter.init(AREA, rng), []
    for k in range(41):
        targets = starts + k * speeds
        state = filter.predict(state, 1.0 if k else 0.0, rng)
        state = filter.update(state, sensor, POSE, sensor.sample(targets, POSE, rng), rng)
        if k in (10, 30, 40):
            means = state.tracks.moments(2)[0].T[:, state.tracks.existence > 0.5]
            labels = state.tracks.labels[state.tracks.existence > 0.5]
            gaps = np.linalg.norm(means[:, :, None] - targets[:, None, :], axis=0)
            if labels.size < 2 or gaps.min(axis=0).max() > 3.0:
                return False
            names.append(labels[gaps.argmin(axis=0)].tolist())
    return names[0] == names[1] == names[2]


def test_targets_that_cross_keep_their_labels() -> None:
    assert sum(crossed(seed) for seed in range(8)) >= 7


def test_rivals_for_one_target_become_one_track() -> None:
    filter, rng = Lmb(Lmb.Config(expected_targets=0.0)), np.random.default_rng(0)
    state = state_of(filter, np.array([[20.0, 20.1, 60.0], [30.0, 30.0, 60.0]]), [0.3, 0.6, 0.4])
    after = filter.update(state, linear(gain=0.0), POSE, np.zeros((0, 2)), rng)
    assert after.tracks.labels.tolist() == [1, 2]
    assert after.tracks.existence == pytest.approx([0.9, 0.4])
    assert after.tracks.moments(2)[0][0] == pytest.approx([(0.3 * 20.0 + 0.6 * 20.1) / 0.9, 30.0])
    both = state_of(filter, np.array([[20.0, 20.1], [30.0, 30.0]]), [0.7, 0.6])  # more than one target
    assert filter.update(both, linear(gain=0.0), POSE, np.zeros((0, 2)), rng).tracks.count == 2


def test_targets_known_to_keep_apart_are_not_tracked_twice() -> None:
    """Given that not both of two exist, r is (r1 (1 - r2) + r2 (1 - r1)) / (1 - r1 r2)."""
    filter, rng = Lmb(Lmb.Config(expected_targets=0.0, spacing_m=2.0)), np.random.default_rng(0)
    state = state_of(filter, np.array([[20.0, 20.5, 60.0], [30.0, 30.0, 60.0]]), [0.9, 0.8, 0.95])
    after = filter.update(state, linear(gain=0.0), POSE, np.zeros((0, 2)), rng)
    assert after.tracks.labels.tolist() == [0, 2]
    assert after.tracks.existence == pytest.approx([(0.9 * 0.2 + 0.8 * 0.1) / (1.0 - 0.72), 0.95])
    wide = state_of(filter, np.array([[20.0, 20.5], [30.0, 30.0]]), [0.9, 0.8], spread=3.0)
    assert filter.update(wide, linear(gain=0.0), POSE, np.zeros((0, 2)), rng).tracks.count == 2


def test_the_cap_keeps_the_likeliest_tracks() -> None:
    filter, rng = Lmb(Lmb.Config(expected_targets=5.0, tracks=3)), np.random.default_rng(0)
    places = np.arange(10.0, 60.0, 10.0)
    state = state_of(filter, np.stack([places, places]), [0.1, 0.9, 0.2, 0.8, 0.3])
    after = filter.update(state, linear(gain=0.0), POSE, np.zeros((0, 2)), rng)
    assert after.tracks.labels.tolist() == [1, 3, 4]
    z = np.array([[80.0, 20.0]])
    assert filter.update(after, linear(clutter=0.0), POSE, z, rng).tracks.count == 3


def test_a_million_measurements_at_once_are_no_trouble() -> None:
    filter, rng = Lmb(Lmb.Config(expected_targets=5.0, tracks=50)), np.random.default_rng(0)
    state = state_of(filter, np.array([[20.0], [30.0]]), [0.9])
    z = rng.uniform(0.0, 100.0, (1_000_000, 2))
    after = filter.update(state, linear(clutter=1e6), POSE, z, rng)
    assert after.tracks.count <= 50
    assert np.isfinite(after.tracks.existence).all()
    assert np.isfinite(after.tracks.components.means).all()


def test_what_certainty_forbids_has_a_defined_result() -> None:
    """r as large as it gets, p_D = 1, no clutter: a miss ends the track, two measurements share it."""
    filter, rng, sensor = lmb(expected_targets=0.0), np.random.default_rng(0), linear(gain=1.0, clutter=0.0)
    state = state_of(filter, np.array([[20.0], [30.0]]), [filter.config.most_existence])
    assert filter.update(state, sensor, POSE, np.zeros((0, 2)), rng).tracks.count == 0
    z = np.array([[20.3, 30.0], [19.7, 30.0]])
    after = filter.update(state, sensor, POSE, z, rng)
    assert after.tracks.existence == pytest.approx([1.0], abs=1e-5)
    assert after.tracks.moments(2)[0][0] == pytest.approx([20.0, 30.0], abs=1e-6)


def test_a_covariance_that_is_none_is_named() -> None:
    filter, rng = lmb(), np.random.default_rng(0)
    state = state_of(filter, np.array([[20.0], [30.0]]), [0.9])
    flat = replace(state.tracks.components, covariances=np.zeros((1, 2, 2)))
    broken = replace(state, tracks=replace(state.tracks, components=flat))
    with pytest.raises(ValueError, match="covariances"):
        filter.update(broken, linear(), POSE, np.zeros((0, 2)), rng)


def test_moments_are_those_of_the_mixture() -> None:
    parts = Components(
        np.array([0.25, 0.75]), np.array([[0.0, 0.0], [4.0, 0.0]]), np.stack([np.eye(2), 2.0 * np.eye(2)])
    )
    tracks = Tracks(np.array([7]), np.array([0.5]), np.array([0, 2]), parts)
    mean, covariance = tracks.moments(2)
    assert mean[0].tolist() == [3.0, 0.0]
    assert covariance[0] == pytest.approx(np.array([[1.75 + 3.0, 0.0], [0.0, 1.75]]))
