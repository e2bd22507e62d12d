"""Where new targets come from: evenly in the area, or where measurements are (Ristic et al. 2012)."""

from typing import Any

import numpy as np
import pytest

from estimator.filter import Area
from estimator.smc.smc_phd import SmcPhd
from tests.estimator.smc.positions import Positions

AREA = Area(np.zeros(2), np.full(2, 20.0))
POSE = np.zeros(4)
INITIALS = ("undetected", "grid")


def filter_with(**changes: Any) -> SmcPhd:
    base = {"expected_targets": 0.0, "birth": 0.02, "birth_at": "measurements"}
    return SmcPhd(SmcPhd.Config(**{**base, **changes}))


@pytest.mark.parametrize("initial", INITIALS)
@pytest.mark.parametrize("clutter", [0.0, 0.001])
@pytest.mark.parametrize("p_d", [0.3, 1.0])
def test_a_newborn_target_competes_with_clutter_as_in_the_closed_form(
    initial: str, clutter: float, p_d: float
) -> None:
    """Detected for certain: gamma / (gamma + c) for each measurement, whatever p_D is; gamma is per m^2."""
    settings = {"particles": 5000, "cluster_cutoff_m": 3.0, "cluster_least_mass": 0.05}
    filter, rng = filter_with(initial=initial, **settings), np.random.default_rng(0)
    sensor = Positions(p_d=p_d, clutter=clutter)
    state = filter.predict(filter.init(AREA, rng), 5.0, rng)
    assert filter.mass(state) == pytest.approx(0.1)
    z = np.array([[8.0, 9.0], [13.0, 5.0]])
    state = filter.update(state, sensor, POSE, z, rng)
    gamma = 0.1 / 400.0
    assert filter.mass(state) == pytest.approx(2 * gamma / (gamma + clutter), rel=0.05)
    _, clusters = filter.clusters(state, rng)
    assert np.allclose(clusters.means[:, np.argsort(clusters.means[0])], z.T, atol=0.5)


@pytest.mark.parametrize("initial", INITIALS)
def test_newborn_targets_that_were_not_seen_were_not_there(initial: str) -> None:
    filter, rng = filter_with(initial=initial), np.random.default_rng(0)
    state = filter.predict(filter.init(AREA, rng), 5.0, rng)
    state = filter.update(state, Positions(), POSE, np.zeros((0, 2)), rng)
    assert filter.mass(state) == 0.0


def test_births_wait_in_all_the_time_between_two_sets() -> None:
    filter, rng = filter_with(survival=0.5), np.random.default_rng(0)
    state = filter.init(AREA, rng)
    state = filter.predict(filter.predict(state, 1.0, rng), 1.0, rng)
    assert filter.mass(state) == pytest.approx(0.5 * 0.02 + 0.02)


@pytest.mark.parametrize(
    ("initial", "birth_at"),
    # ("grid", "area") would need very many particles for the few newborn targets that wait everywhere
    [("undetected", "area"), ("undetected", "measurements"), ("grid", "measurements")],
)
def test_a_target_that_comes_later_is_found(initial: str, birth_at: str) -> None:
    filter = filter_with(initial=initial, birth_at=birth_at, particles=3000, expected_targets=0.5)
    sensor, rng = Positions(p_d=0.9, clutter=1e-4), np.random.default_rng(1)
    state = filter.init(AREA, rng)
    target = np.array([[6.0], [14.0]])
    for k in range(24):
        state = filter.predict(state, 0.5, rng)
        state = filter.update(state, sensor, POSE, sensor.sample(target[:, : int(k > 12)], POSE, rng), rng)
        state, clusters = filter.clusters(state, rng)
        if k == 12:
            assert filter.mass(state) < 0.2
    assert clusters.masses[0] == pytest.approx(1.0, abs=0.4)
    assert np.allclose(clusters.means[:, 0], target[:, 0], atol=1.0)


def test_births_in_the_area_become_particles_where_particles_are_everywhere() -> None:
    filter = filter_with(initial="grid", birth_at="area", birth=2.0, expected_targets=1.0)
    rng = np.random.default_rng(0)
    state = filter.init(AREA, rng)
    later = filter.predict(state, 1.5, rng)
    assert filter.mass(later) == pytest.approx(4.0)
    born = later.positions[:, state.weights.size :]
    assert born.shape[1] == 1500
    assert ((born >= 0) & (born <= 20)).all()
    assert np.allclose(born.mean(axis=1), 10.0, atol=0.6)


def test_newborn_targets_get_a_velocity() -> None:
    motion = {"kind": "constant_velocity", "speed": 3.0, "acceleration": 0.1}
    for initial in INITIALS:
        filter = SmcPhd(
            SmcPhd.Config(
                expected_targets=0.0,
                birth=0.1,
                birth_at="measurements",
                initial=initial,
                motion=_motion(motion),
            )
        )
        rng = np.random.default_rng(0)
        state = filter.predict(filter.init(AREA, rng), 1.0, rng)
        state = filter.update(state, Positions(), POSE, np.array([[8.0, 9.0]]), rng)
        seen = state.weights > 0.0
        assert state.states[2:, seen].std() == pytest.approx(3.0, rel=0.1)


def _motion(table: dict[str, Any]) -> Any:
    from estimator.motion import MotionConfig

    return MotionConfig(**table)
