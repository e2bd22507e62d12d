"""The mixtures filter against brute force on a grid, and what it promises beyond the shared contract."""

from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components, moments_of
from estimator.motion import MotionConfig
from estimator.sensors.range_bearing import RangeBearing
from estimator.soft.config import MixturesConfig, TargetTable
from estimator.soft.mixtures import Mixtures, MixturesState
from estimator.soft.models import directions, ranges
from estimator.soft.statement import SoftObservation
from tests.estimator.soft import grids

AREA = Area(np.full(2, -10.0), np.full(2, 10.0))
NEAR = ranges(np.array([1.0, 0.0]), 2.0, 4.0, 4.0)
POSE = np.array([0.0, -3.0, 0.0, 0.4])
# Section IV-B of the paper.
PAPER = [((1.5, 1.3), (0.103, 1.526)), ((4.25, -1.7), (2.648, 1.28)), ((1.25, 0.55), (-0.973, -0.214))]


def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def target(name: str, x: float, y: float, sigma: float = 1.0) -> TargetTable:
    return TargetTable(name=name, mean_m=[x, y], sigma_m=sigma)


def made(*targets: TargetTable, **changes: Any) -> tuple[Mixtures, MixturesState]:
    filter = Mixtures(MixturesConfig(targets=list(targets), samples=128, **changes))
    return filter, filter.init(AREA, rng())


def sensor(**changes: Any) -> RangeBearing:
    table = {
        "period_s": 1.0,
        "range_sigma_m": 0.4,
        "bearing_sigma_deg": 4.0,
        "gain": 0.8,
        "clutter": 0.5,
        "reach_m": [6.0, 3.0],
    }
    return RangeBearing.of(RangeBearing.Config(**{**table, **changes}), AREA)


def near(mixture: Components, exact: FloatArray, share: float = 0.08) -> None:
    """The mixture's moments are the grid's, to a share of the standard deviation."""
    mean, covariance = grids.moments(exact)
    got_mean, got = moments_of(mixture)
    assert np.linalg.norm(got_mean - mean) < share * np.sqrt(np.trace(covariance))
    assert np.linalg.norm(got - covariance) < 1.5 * share * np.trace(covariance)


def likelihood(model: RangeBearing, z: FloatArray) -> FloatArray:
    """p_D(x) g(z | x) at the grid's points."""
    look = model.look(grids.POINTS, POSE, z[None])
    out = np.zeros(grids.POINTS.shape[1])
    out[look.indices] = look.detection[look.indices] * look.likelihood
    return out


def test_the_uniform_prior_has_the_moments_of_the_uniform_density() -> None:
    _, state = made(TargetTable(name="a"))
    mean, covariance = moments_of(state.mixtures[0])
    np.testing.assert_allclose(mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(covariance, 20.0**2 / 12.0 * np.eye(2), atol=1e-9)
    inside = grids.density(state.mixtures[0])[(np.abs(grids.POINTS) < 5.0).all(axis=0)]
    assert inside.std() < 0.03 * inside.mean()


def test_an_empty_set_is_the_factor_of_missed_detection() -> None:
    filter, state = made(target("a", 1.0, -2.0, 2.5), target("b", 8.0, 8.0, 0.5))
    model = sensor()
    after = filter.update(state, model, POSE, np.zeros((0, 2)), rng())
    missed = 1.0 - model.detection(grids.POINTS, POSE[None])[0]
    for before, mixture in zip(state.mixtures, after.mixtures, strict=True):
        exact, _ = grids.posterior(before, missed)
        near(mixture, exact)
        assert grids.apart(exact, mixture) < 0.08
    assert filter.mass(after) == 2.0


def test_where_nothing_can_be_detected_nothing_changes_at_all() -> None:
    filter, state = made(target("a", 1.0, -2.0), target("b", 3.0, 3.0))
    after = filter.update(state, sensor(gain=0.0), POSE, np.zeros((0, 2)), rng())
    for before, mixture in zip(state.mixtures, after.mixtures, strict=True):
        np.testing.assert_array_equal(mixture.means, before.means)
        np.testing.assert_array_equal(mixture.covariances, before.covariances)


def test_one_target_and_clutter_give_the_grids_posterior() -> None:
    filter, state = made(target("a", 1.0, -1.0, 1.5))
    model = sensor()
    z = np.concatenate([model.measure(np.array([[2.0, -3.0], [-0.5, 4.0]]), POSE)])
    exact_likelihood = 1.0 - model.detection(grids.POINTS, POSE[None])[0]
    for row, c in zip(z, model.clutter_intensity(z, POSE), strict=True):
        exact_likelihood = exact_likelihood + likelihood(model, row) / c
    exact, _ = grids.posterior(state.mixtures[0], exact_likelihood)
    near(filter.update(state, model, POSE, z, rng()).mixtures[0], exact)


def test_two_targets_and_two_measurements_give_the_grids_marginals() -> None:
    """All seven joint associations, each by quadrature."""
    filter, state = made(target("a", 1.5, -0.5, 1.0), target("b", 3.0, 0.5, 1.0))
    model = sensor(clutter=2.0)
    z = model.measure(np.array([[1.8, 3.2], [0.0, 0.2]]), POSE)
    clutter = model.clutter_intensity(z, POSE)
    missed = 1.0 - model.detection(grids.POINTS, POSE[None])[0]
    factors = [missed, *(likelihood(model, row) / c for row, c in zip(z, clutter, strict=True))]
    priors = [grids.density(m) for m in state.mixtures]
    evidence = np.array([[(p * f).sum() for f in factors] for p in priors])
    joint = np.outer(evidence[0], evidence[1])
    joint[1, 1] = joint[2, 2] = 0.0
    joint /= joint.sum()
    after = filter.update(state, model, POSE, z, rng())
    for i, share in enumerate((joint.sum(axis=1), joint.sum(axis=0))):
        exact = sum(s / e * priors[i] * f for s, e, f in zip(share, evidence[i], factors, strict=True))
        near(after.mixtures[i], np.asarray(exact))


@pytest.mark.parametrize("positive", [True, False])
def test_a_statement_about_a_named_target_changes_it_alone(positive: bool) -> None:
    filter, state = made(*(target(f"cone {i}", *mean) for i, (mean, _) in enumerate(PAPER)))
    told = SoftObservation.of(NEAR, "around", positive=positive, target="cone 1")
    after = filter.observe(state, told, rng())
    assert after.mixtures[0] is state.mixtures[0]
    assert after.mixtures[2] is state.mixtures[2]
    agreement = grids.agreement(NEAR.softmax, told.own.tolist())
    near(after.mixtures[1], grids.posterior(state.mixtures[1], agreement)[0])


def test_nothing_is_near_holds_for_every_target() -> None:
    filter, state = made(*(target(f"{i}", *mean) for i, (mean, _) in enumerate(PAPER)))
    told = SoftObservation.of(NEAR, "near", positive=False)
    after = filter.observe(state, told, rng())
    agreement = grids.agreement(NEAR.softmax, told.own.tolist())
    for before, mixture in zip(state.mixtures, after.mixtures, strict=True):
        near(mixture, grids.posterior(before, agreement)[0])


def test_something_is_near_holds_for_one_target() -> None:
    filter, state = made(*(target(f"{i}", *mean) for i, (mean, _) in enumerate(PAPER)), target("far", 9, 9))
    told = SoftObservation.of(NEAR, "near")
    after = filter.observe(state, told, rng())
    agreement = grids.agreement(NEAR.softmax, told.own.tolist())
    exact = [grids.posterior(m, agreement) for m in state.mixtures]
    total = sum(evidence for _, evidence in exact)
    for before, mixture, (posterior, evidence) in zip(state.mixtures, after.mixtures, exact, strict=True):
        meant = evidence / total
        near(mixture, meant * posterior + (1.0 - meant) * grids.density(before))


def test_an_operator_who_errs_moves_a_density_less() -> None:
    surprising = SoftObservation.of(NEAR, "near", target="a")
    sure, state = made(target("a", 8.0, 0.0))
    wary, _ = made(target("a", 8.0, 0.0), operator_error=0.2)
    assert moments_of(sure.observe(state, surprising, rng()).mixtures[0])[0][0] < 4.5
    assert moments_of(wary.observe(state, surprising, rng()).mixtures[0])[0][0] > 7.5


def test_targets_that_are_alike_share_no_measurement() -> None:
    """Three seen at once: three narrow densities and two that know nothing of them, not five smeared ones."""
    filter = Mixtures(MixturesConfig(unnamed=5))
    state = filter.init(AREA, rng())
    model = sensor(gain=1.0, clutter=0.01, reach_m=[1e4, 1e4])
    z = model.measure(np.array([[5.0, -5.0, 0.0], [5.0, 5.0, -8.0]]), POSE)
    after = filter.update(state, model, POSE, z, rng())
    widths = sorted(float(np.trace(moments_of(m)[1])) for m in after.mixtures)
    assert widths[2] < 2.0
    assert widths[3] > 20.0
    assert (after.kinds >= 0).sum() == 2


def test_something_said_of_targets_that_are_alike_makes_one_of_them_known() -> None:
    filter = Mixtures(MixturesConfig(unnamed=3))
    state = filter.init(AREA, rng())
    after = filter.observe(state, SoftObservation.of(NEAR, "near"), rng())
    assert np.linalg.norm(moments_of(after.mixtures[0])[0] - [1.0, 0.0]) < 0.3
    assert after.mixtures[1] is state.mixtures[1]
    assert after.kinds.tolist() == [-1, 0, 0]


def test_the_frame_may_be_turned_and_moved() -> None:
    c, s = np.cos(1.1), np.sin(1.1)
    turn, shift = np.array([[c, -s], [s, c]]), np.array([2.0, -1.0])
    means = []
    for moved in (False, True):
        place, x = np.array([1.0, 0.0]), np.array([4.0, 1.0])
        pose = np.array([*place, 0.0, 0.3 + 1.1 * moved])
        if moved:
            x = turn @ x + shift
            pose[:2] = turn @ place + shift
        filter, state = made(target("a", *x))
        told = SoftObservation.of(directions(pose, 5.0), "left of", target="a")
        means.append(moments_of(filter.observe(state, told, rng()).mixtures[0])[0])
    np.testing.assert_allclose(turn @ means[0] + shift, means[1], atol=0.05)


def test_velocities_follow_what_is_said_of_positions() -> None:
    motion = MotionConfig(kind="constant_velocity", acceleration=0.1, speed=1.0)
    filter, state = made(target("a", 0.0, 0.0, 0.5), motion=motion)
    state = filter.predict(state, 3.0, rng())
    east = SoftObservation.of(directions(np.zeros(4), 6.0), "in front of", target="a")
    after = filter.observe(state, east, rng())
    mean, covariance = moments_of(after.mixtures[0])
    assert mean[2] > 0.3
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    z = sensor().measure(np.array([[3.0], [0.0]]), POSE)
    assert moments_of(filter.update(after, sensor(), POSE, z, rng()).mixtures[0])[0][2] == pytest.approx(
        0.9, abs=0.3
    )


def test_what_cannot_have_been_is_ignored() -> None:
    filter, state = made(target("a", 1.0, -2.0, 0.3))
    sure = sensor(gain=1.0, reach_m=[1e9, 1e9], clutter=0.0)
    for z in (np.zeros((0, 2)), np.array([[500.0, 1.0]])):
        after = filter.update(state, sure, POSE, z, rng())
        np.testing.assert_allclose(moments_of(after.mixtures[0])[0], [1.0, -2.0], atol=0.1)


def test_no_target_left_is_a_state_too() -> None:
    filter, state = made(target("a", 0.0, 0.0, 0.1))
    state, clusters = filter.clusters(state, rng())
    assert clusters.labels is not None
    assert clusters.labels.tolist() == [0]
    state = filter.remove(state, np.array([0]))
    state = filter.observe(state, SoftObservation.of(NEAR, "near"), rng())
    state = filter.update(filter.predict(state, 1.0, rng()), sensor(), POSE, np.ones((2, 2)), rng())
    assert filter.mass(state) == 0.0
    assert filter.clusters(state, rng())[1].means.shape == (2, 0)


def test_the_same_generator_gives_the_same_bits() -> None:
    filter, state = made(TargetTable(name="a"), target("b", 3.0, 0.0))
    told = SoftObservation.of(NEAR, "around")
    one, other = (filter.observe(state, told, np.random.default_rng(5)) for _ in range(2))
    for a, b in zip(one.mixtures, other.mixtures, strict=True):
        assert a.means.tobytes() == b.means.tobytes()
        assert a.covariances.tobytes() == b.covariances.tobytes()


@pytest.mark.parametrize(
    ("table", "argument"),
    [
        ({"targets": [target("a", 0.0, 0.0), target("a", 1.0, 1.0)]}, "targets"),
        ({"unnamed": 0}, "targets"),
        ({"targets": [TargetTable(name="a", mean_m=[1.0])]}, "mean_m"),
        ({"targets": [TargetTable(name="a", mean_m=[np.nan, 1.0], sigma_m=1.0)]}, "mean_m"),
        ({"targets": [TargetTable(name="a", mean_m=[1.0, 1.0])]}, "sigma_m"),
    ],
)
def test_a_table_that_means_nothing_is_refused(table: dict[str, Any], argument: str) -> None:
    with pytest.raises(ValueError, match=argument):
        Mixtures(MixturesConfig(**table)).init(AREA, rng())


def test_a_statement_that_means_nothing_is_refused() -> None:
    filter, state = made(target("a", 0.0, 0.0))
    with pytest.raises(ValueError, match="target: expected one of those not found yet"):
        filter.observe(state, SoftObservation.of(NEAR, "near", target="b"), rng())
    high = ranges(np.zeros(2), 1.0, 2.0, 3.0, dimension=3)
    with pytest.raises(ValueError, match="softmax"):
        filter.observe(state, SoftObservation.of(high, "near"), rng())
    with pytest.raises(ValueError, match="relation"):
        SoftObservation.of(NEAR, "behind")
    with pytest.raises(ValueError, match="category"):
        SoftObservation(NEAR.softmax, 3)
