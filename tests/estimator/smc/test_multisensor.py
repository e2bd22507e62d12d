"""Several sensors' sets applied to particles at once."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from estimator.filter import Area
from estimator.multisensor import Take, jointly_corrected
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.multisensor import updated_together
from estimator.smc.smc_phd import SmcPhd
from estimator.smc.state import SmcPhdState

AREA = Area(np.zeros(2), np.full(2, 100.0))
TARGETS = np.array([[30.0, 62.0, 75.0], [40.0, 71.0, 20.0]])
POSES = [np.array([50.0, 50.0, 5.0, 0.3]), np.array([20.0, 60.0, 5.0, 0.0]), np.array([70.0, 30.0, 5.0, 2.0])]


def sensor(gain: float = 0.9, clutter: float = 0.5) -> RangeBearing:
    return RangeBearing.of(
        RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=0.5,
            bearing_sigma_deg=1.0,
            reach_m=[1e4, 1e4],
            gain=gain,
            clutter=clutter,
        ),
        AREA,
    )


def takes(seed: int) -> list[Take]:
    rng = np.random.default_rng(seed)
    models = [sensor(0.7), sensor(0.8), sensor(0.9)]
    return [Take(m, pose, m.sample(TARGETS, pose, rng)) for m, pose in zip(models, POSES, strict=True)]


def clouds(filter: SmcPhd, n: int = 600) -> SmcPhdState:
    rng = np.random.default_rng(0)
    x = TARGETS[:, rng.integers(0, 3, n)] + rng.standard_normal((2, n))
    return replace(filter.init(AREA, rng), states=x, weights=np.full(n, 3.0 / n), labels=np.full(n, -1))


def test_particles_follow_the_corrector_in_any_order_of_the_sensors_to_1e_9() -> None:
    filter, given = SmcPhd(SmcPhd.Config(expected_targets=0.0)), takes(1)
    state = clouds(filter)
    looks = [t.sensor.look(state.positions, t.pose, t.measurements) for t in given]
    expected = jointly_corrected(state.weights, looks)
    for order in permutations(range(3)):
        after = updated_together(filter, state, [given[s] for s in order], np.random.default_rng(1))
        assert np.allclose(after.weights, expected, rtol=1e-9, atol=1e-15)


def test_mass_with_an_undetected_part_does_not_depend_on_the_order_either() -> None:
    filter, given = SmcPhd(SmcPhd.Config(expected_targets=4.0)), takes(2)
    state = clouds(filter)
    masses = [
        filter.mass(updated_together(filter, state, [given[s] for s in order], np.random.default_rng(1)))
        for order in permutations(range(3))
    ]
    assert np.allclose(masses, masses[0], rtol=1e-9)


def test_three_sensors_that_first_see_a_target_together_make_one_of_it() -> None:
    filter, rng, model = (
        SmcPhd(SmcPhd.Config(expected_targets=2.0)),
        np.random.default_rng(3),
        sensor(0.95, 0.1),
    )
    given = [
        Take(model, pose, model.measure(TARGETS[:, :1], pose) + rng.normal(size=2) * model.sigmas)
        for pose in POSES
    ]
    state = updated_together(filter, filter.init(AREA, rng), given, rng)
    assert state.weights.sum() == pytest.approx(1.0, abs=0.05)
    mean = np.average(state.positions, axis=1, weights=state.weights)
    assert np.linalg.norm(mean - TARGETS[:, 0]) < 0.8
    assert filter.mass(filter.update(state, model, POSES[0], given[0].measurements, rng)) < 3.0


def test_no_set_changes_nothing_and_bad_ones_are_named() -> None:
    filter, rng = SmcPhd(SmcPhd.Config()), np.random.default_rng(0)
    state = clouds(filter)
    assert updated_together(filter, state, [], rng) is state
    with pytest.raises(ValueError, match="measurements"):
        updated_together(filter, state, [Take(sensor(), POSES[0], np.ones((1, 3)))], rng)
