"""What statements make of an intensity, against sampled point processes and closed forms."""

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.search import Search
from estimator.smc.config import SmcPhdConfig
from estimator.smc.smc_phd import SmcPhd
from estimator.soft.intensity import factors
from estimator.soft.models import ranges, region
from estimator.soft.statement import SoftObservation

AREA = Area(np.zeros(2), np.full(2, 40.0))
PLACES: FloatArray = np.random.default_rng(0).uniform(0.0, 40.0, (2, 12))
TREE = ranges(np.array([12.0, 15.0]), 8.0, 16.0, 0.5)


@pytest.mark.parametrize("positive", [True, False])
@pytest.mark.parametrize("known", [np.zeros(0), np.array([0.3]), np.array([0.6, 0.2])])
def test_factors_are_those_of_sampled_point_processes(positive: bool, known: FloatArray) -> None:
    """Targets at 12 places in Poisson numbers; a run counts if the statement came true in it."""
    rng = np.random.default_rng(1)
    statement = SoftObservation.of(TREE, "near", positive=positive)
    p = TREE.softmax.probabilities(PLACES)[0]
    weights = rng.uniform(0.02, 0.25, 12)
    counts = rng.poisson(weights, (400_000, 12))
    none = ((1.0 - p) ** counts).prod(axis=1)
    truth = 1.0 - none * np.prod(1.0 - known) if positive else none
    posterior = (truth @ counts) / truth.sum()
    got = weights * factors(statement, p, weights, known)
    np.testing.assert_allclose(got, posterior, atol=5e-3)


def test_something_brings_the_mass_of_at_least_one_to_where_it_is() -> None:
    """As the intensity there vanishes, at least one becomes exactly one, spread as p v."""
    statement = SoftObservation.of(TREE, "near")
    p = TREE.softmax.probabilities(PLACES)[0]
    weights = np.full(12, 1e-9)
    got = weights * factors(statement, p, weights, None)
    np.testing.assert_allclose(got, p / p.sum() + weights, rtol=1e-6)


def test_what_cannot_have_been_is_ignored_and_many_targets_make_something_no_news() -> None:
    statement = SoftObservation.of(TREE, "near")
    np.testing.assert_array_equal(factors(statement, np.zeros(3), np.ones(3), None), 1.0)
    np.testing.assert_allclose(factors(statement, np.ones(3), np.full(3, 1e6), None), 1.0)


def test_a_found_target_there_makes_something_no_news() -> None:
    statement = SoftObservation.of(TREE, "near")
    p, weights = np.array([0.5, 0.1]), np.array([0.2, 0.4])
    np.testing.assert_array_equal(factors(statement, p, weights, np.array([1.0])), 1.0)


@pytest.mark.parametrize("initial", ["undetected", "grid"])
def test_smc_phd_takes_statements_on_the_grid_and_in_the_particles(initial: str) -> None:
    config = SmcPhdConfig(particles=2000, expected_targets=3.0, initial=initial)  # type: ignore[arg-type]
    filter = SmcPhd(config)
    rng = np.random.default_rng(2)
    state = filter.init(AREA, rng)
    square = region(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0]]), 20.0)
    quiet = filter.observe(state, SoftObservation.of(square, "inside", positive=False), rng)
    assert filter.mass(quiet) == pytest.approx(3.0 * 0.75, rel=0.03)
    points, weights = filter.points(quiet)
    expected = float(square.softmax.probabilities(points)[square.category("inside")] @ weights)
    loud = filter.observe(quiet, SoftObservation.of(square, "inside"), rng)
    assert filter.mass(loud) == pytest.approx(filter.mass(quiet) + expected / np.expm1(expected))
    far = (points > 25.0).any(axis=0)
    np.testing.assert_allclose(filter.points(loud)[1][far], weights[far])


def test_named_targets_and_other_dimensions_are_refused_by_name() -> None:
    filter = SmcPhd(SmcPhdConfig(particles=100))
    rng = np.random.default_rng(0)
    state = filter.init(AREA, rng)
    with pytest.raises(ValueError, match="target: this filter knows no target 'cone 3'"):
        filter.observe(state, SoftObservation.of(TREE, "near", target="cone 3"), rng)
    model = ranges(np.zeros(2), 1.0, 2.0, 1.0, dimension=3)
    with pytest.raises(ValueError, match="softmax: a model in 3 dimensions"):
        filter.observe(state, SoftObservation.of(model, "near"), rng)


def test_a_search_applies_statements_at_their_time_and_explores_nothing() -> None:
    search = Search(SmcPhd(SmcPhdConfig(particles=100, birth=0.1)), AREA, [5, 5], radius=1, mass=0.8, gate=3)
    rng = np.random.default_rng(0)
    state = search.init(rng)
    after = search.observe(state, SoftObservation.of(TREE, "near", positive=False), 4.0, rng)
    assert (after.time, after.sets) == (4.0, 0)
    np.testing.assert_array_equal(after.exploration.values, state.exploration.values)
    with pytest.raises(ValueError, match="capture_time"):
        search.observe(state, SoftObservation.of(TREE, "near"), np.nan, rng)
