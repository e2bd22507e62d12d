"""Filters' states as beliefs and back."""

from typing import Any

import numpy as np
import pytest

from estimator.averaging.attention import Attention
from estimator.averaging.belief import average
from estimator.averaging.states import belief_of, state_with
from estimator.filter import Area
from estimator.gaussian.gm_phd import GmPhd
from estimator.lmb.lmb import Lmb
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.smc_phd import SmcPhd

AREA = Area(np.zeros(2), np.full(2, 20.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0, range_sigma_m=0.2, bearing_sigma_deg=1.0, reach_m=[200.0, 200.0], gain=0.95, clutter=0.5
    ),
    AREA,
)
FILTERS: list[Any] = [SmcPhd(SmcPhd.Config(particles=2000)), GmPhd(GmPhd.Config()), Lmb(Lmb.Config())]
TARGETS = np.array([[4.0, 12.0, 15.0], [5.0, 15.0, 3.0]])


def seen(filter: Any) -> Any:
    rng = np.random.default_rng(3)
    state = filter.init(AREA, rng)
    for k in range(12):
        pose = np.array([10.0, 2.0 * k, 0.0, 0.0])
        state = filter.update(
            filter.predict(state, 1.0, rng), SENSOR, pose, SENSOR.sample(TARGETS, pose, rng), rng
        )
    return state


@pytest.mark.parametrize("filter", FILTERS)
def test_a_belief_has_the_mass_of_its_filter_and_lies_where_targets_are(filter: Any) -> None:
    state = seen(filter)
    belief = belief_of(state, Attention.none(AREA, (9, 9)))
    assert belief.mass == pytest.approx(filter.mass(state), rel=1e-9)
    for target in TARGETS.T:
        near = np.linalg.norm(belief.means - target, axis=1) < 1.0
        assert belief.weights[near].sum() == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("filter", FILTERS[:2])
def test_a_filter_goes_on_with_the_average_as_with_its_own_state(filter: Any) -> None:
    state = seen(filter)
    belief = belief_of(state, Attention.none(AREA, (9, 9)))
    back = state_with(state, average([belief, belief], np.full(2, 0.5)))
    assert filter.mass(back) == pytest.approx(filter.mass(state), rel=1e-3)
    rng = np.random.default_rng(0)
    pose = np.array([10.0, 10.0, 0.0, 0.0])
    later, clusters = filter.clusters(
        filter.update(back, SENSOR, pose, SENSOR.measure(TARGETS, pose), rng), rng
    )
    assert filter.mass(later) > 2.5
    assert (clusters.masses > 0.5).sum() == 3


def test_what_fits_no_filter_is_refused() -> None:
    with pytest.raises(ValueError, match="state"):
        belief_of(object(), Attention.none(AREA, (9, 9)))  # type: ignore[arg-type]
    particles, mixture = (belief_of(seen(filter), Attention.none(AREA, (9, 9))) for filter in FILTERS[:2])
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="belief"):
        state_with(FILTERS[0].init(AREA, rng), mixture)
    with pytest.raises(ValueError, match="belief"):
        state_with(FILTERS[1].init(AREA, rng), particles)
