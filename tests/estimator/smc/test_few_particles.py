"""What few particles stand for: neither narrower nor more certain than they can be."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.filter import Area
from estimator.search import Search
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd, SmcPhdState

AREA = Area(np.zeros(2), np.full(2, 10.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=0.3,
        bearing_sigma_deg=3.0,
        gain=0.9,
        clutter=0.1,
        field_of_view="sector",
        range_m=9.0,
        angle_deg=120.0,
    ),
    AREA,
)


def few(filter: SmcPhd, positions: list[list[float]], reach: float = 0.9) -> SmcPhdState:
    """A state of particles at positions (n, 2), half a target each."""
    points = np.array(positions).T
    n = points.shape[1]
    return replace(
        filter.init(AREA, np.random.default_rng(0)),
        states=points,
        weights=np.full(n, 0.5),
        labels=np.full(n, -1),
        reach=reach,
    )


def test_a_cluster_of_few_particles_is_as_wide_as_the_floor_says() -> None:
    rng = np.random.default_rng(0)
    plain, wide = (SmcPhd(SmcPhd.Config(cluster_floor=f)) for f in (0.0, 1.0))
    positions = [[5.0, 5.0]] * 4
    assert plain.clusters(few(plain, positions), rng)[1].radii.tolist() == [0.0]
    assert wide.clusters(few(wide, positions), rng)[1].radii == pytest.approx([0.3 / 2.0])


def test_roughening_moves_copies_and_keeps_the_mass() -> None:
    rng = np.random.default_rng(1)
    for roughening, places in ((0.0, 2), (0.2, 100)):
        filter = SmcPhd(SmcPhd.Config(particles=100, roughening=roughening))
        state = filter.resampled(few(filter, [[2.0, 2.0], [7.0, 7.0]]), rng)
        assert state.weights.sum() == pytest.approx(1.0)
        assert len(np.unique(state.positions, axis=1).T) == places
        if roughening:
            spread = state.positions[:, state.positions[0] < 5.0].std(axis=1)
            assert spread == pytest.approx([0.06, 0.06], rel=0.4)


def test_found_targets_of_single_particles_do_not_end_the_search() -> None:
    filter = SmcPhd(SmcPhd.Config())
    search = Search(filter, AREA, [5, 5], radius=0.5, mass=0.4, gate=0.5, same=4.0)
    rng = np.random.default_rng(2)
    pose = np.array([1.0, 1.0, 0.0, 0.8])
    state = search.init(rng)
    for place in ([5.0, 5.0], [5.0, 5.0], [8.0, 2.0]):
        state = replace(state, filter_state=few(filter, [place]))
        state = search.apply(state, SENSOR, pose, np.zeros((0, 2)), 0.0, rng)
        state = replace(state, filter_state=few(filter, [place, place, place, place]))
        state = search.apply(state, SENSOR, np.array([9.0, 9.0, 0.0, 0.0]), np.zeros((0, 2)), 0.0, rng)
    assert np.isfinite(state.found).all()
    assert state.found.shape[1] == 2
