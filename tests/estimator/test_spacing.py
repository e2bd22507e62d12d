"""The bound that a distance between targets puts on an intensity."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.filter import Area
from estimator.gaussian.gm_phd import GmPhd
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd
from estimator.spacing import capped


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 400), st.sampled_from([2, 3]))
def test_weights_only_fall_and_none_below_what_keeps_one_target_in_its_ball(
    seed: int, n: int, d: int
) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-3.0, 3.0, (d, 6))[:, rng.integers(0, 6, n)] + 0.03 * rng.standard_normal((d, n))
    weights = rng.exponential(0.05, n)
    later = capped(positions, weights, 0.2)
    assert (later <= weights).all()
    assert (later > 0).all()
    assert later.sum() >= min(weights.sum(), 1.0) - 1e-12


@pytest.mark.parametrize("d", [2, 3])
def test_far_apart_clouds_come_down_to_one_target_each(d: int) -> None:
    rng = np.random.default_rng(d)
    centres = 0.15 + np.arange(5)[None, :] * np.ones((d, 1))
    owners = rng.integers(0, 5, 2000)
    positions = centres[:, owners] + 0.004 * rng.standard_normal((d, 2000))
    masses = np.array([0.3, 0.9, 1.0, 2.5, 7.0])
    weights = (masses / np.bincount(owners))[owners]
    later = np.bincount(owners, capped(positions, weights, 0.1))
    assert later == pytest.approx([0.3, 0.9, 1.0, 1.0, 1.0])


def test_two_targets_further_apart_than_the_spacing_both_stay() -> None:
    positions = np.array([[0.0, 0.16], [0.0, 0.0]])
    assert capped(positions, np.array([3.0, 2.0]), 0.1) == pytest.approx([1.0, 1.0])
    assert capped(positions, np.array([3.0, 2.0]), 0.4).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("mass", "left"), [(0.4, 0.3), (0.8, 0.2), (0.95, 0.05), (3.0, 1e-6)])
def test_what_is_nearer_than_the_spacing_has_the_room_that_a_likely_target_leaves(
    mass: float, left: float
) -> None:
    positions = np.array([[0.0, 0.07, 0.12], [0.0, 0.0, 0.0]])
    later = capped(positions, np.array([mass, 0.3, 0.3]), 0.1)
    assert later == pytest.approx([min(mass, 1.0), left, 0.3])


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_what_keeps_to_the_bounds_is_changed_no_more(d: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-1.0, 1.0, (d, 5))[:, rng.integers(0, 5, 200)] + 0.005 * rng.standard_normal(
        (d, 200)
    )
    once = capped(positions, rng.exponential(0.05, 200), 0.2)
    assert capped(positions, once, 0.2) == pytest.approx(once, rel=1e-9, abs=1e-12), f"seed {seed}"


def test_the_frame_does_not_matter() -> None:
    rng = np.random.default_rng(4)
    positions = rng.uniform(0.0, 1.0, (2, 3))[:, rng.integers(0, 3, 300)] + 0.01 * rng.standard_normal(
        (2, 300)
    )
    weights = rng.exponential(0.02, 300)
    moved = np.array([[-1.0], [50.0]]) + positions
    later = capped(positions, weights, 0.15)
    assert capped(moved, weights, 0.15).sum() == pytest.approx(later.sum(), rel=0.02)
    turn = rng.permutation(300)
    assert capped(positions[:, turn], weights[turn], 0.15) == pytest.approx(later[turn])


def test_light_intensities_are_left_as_they_are() -> None:
    weights = np.full(10, 0.09)
    assert capped(np.zeros((2, 10)), weights, 0.1) is weights
    assert capped(np.zeros((2, 0)), np.zeros(0), 0.1).size == 0


def test_bad_input_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="spacing"):
        capped(np.zeros((2, 1)), np.ones(1), 0.0)


@pytest.mark.parametrize(("spacing", "least", "most"), [(0.0, 2.0, 40.0), (0.5, 0.9, 1.0 + 1e-9)])
@pytest.mark.parametrize("kind", [GmPhd, SmcPhd])
def test_a_phd_filter_with_a_low_p_d_counts_a_target_once_if_it_knows_the_spacing(
    kind: type[GmPhd] | type[SmcPhd], spacing: float, least: float, most: float
) -> None:
    """Seen in every one of twenty sets although p_D is only 0.1."""
    area = Area(np.zeros(2), np.full(2, 20.0))
    sensor = RangeBearing.of(
        RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=0.05,
            bearing_sigma_deg=0.5,
            reach_m=[500.0] * 2,
            gain=0.1,
            clutter=0.01,
        ),
        area,
    )
    filter: GmPhd | SmcPhd = kind(kind.Config(expected_targets=0.5, spacing_m=spacing))
    rng = np.random.default_rng(0)
    state: Any = filter.init(area, rng)
    pose, target = np.array([10.0, 10.0, 0.0, 0.0]), np.array([[14.0], [12.0]])
    for _ in range(20):
        state = filter.update(state, sensor, pose, sensor.measure(target, pose), rng)
    _, clusters = filter.clusters(state, rng)
    near = np.linalg.norm(clusters.means - target, axis=0) < 1.0
    assert least <= clusters.masses[near].sum() <= most
