"""The intensity of targets never detected."""

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.newly_detected import detected, explanations
from estimator.sensors.range_bearing import RangeBearing
from estimator.undetected import Undetected

AREA = Area(np.zeros(2), np.full(2, 100.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0, range_sigma_m=1.0, bearing_sigma_deg=2.0, reach_m=[30.0, 30.0], gain=0.9
    ),
    AREA,
)
POSE = np.array([40.0, 45.0, 5.0, 0.0])


def quadrature(prior: Undetected, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points, values of p_D g v and cell area on a grid much finer than the measurement."""
    axis = np.linspace(0.0, 100.0, 1001)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    points = np.stack([x.ravel(), y.ravel()])
    look = SENSOR.look(points, POSE, z)
    g = np.zeros(points.shape[1])
    g[look.indices] = look.likelihood
    return points, look.detection * g * prior.at(points) * 0.01, np.array(0.01)


@pytest.mark.parametrize("z", [[20.0, 0.4], [44.0, -1.3], [3.0, 2.0], [40.0, np.pi]])
def test_what_a_measurement_explains_agrees_with_quadrature(z: list[float]) -> None:
    prior = Undetected.uniform(AREA, (33, 33), 5.0).after(SENSOR, np.array([60.0, 50.0, 5.0, 0.0]))
    measurements = np.array([z])
    _, values, _ = quadrature(prior, measurements)
    explained = explanations(prior, SENSOR, POSE, measurements)
    assert explained.totals[0] == pytest.approx(values.sum(), rel=0.12)


def test_new_particles_have_the_posteriors_mass_mean_and_covariance() -> None:
    prior, z = Undetected.uniform(AREA, (33, 33), 5.0), np.array([[25.0, 0.8], [10.0, -2.0]])
    points, values, _ = quadrature(prior, z[:1])
    explained = explanations(prior, SENSOR, POSE, z)
    x, w = detected(
        prior, SENSOR, POSE, z, explained, np.array([0.7, 0.0]), np.array([5000, 0]), np.random.default_rng(0)
    )
    assert w.sum() == pytest.approx(0.7)
    mean = np.average(points, axis=1, weights=values)
    assert np.allclose(np.average(x, axis=1, weights=w), mean, atol=0.08)
    assert np.allclose(np.cov(x, aweights=w), np.cov(points, aweights=values), atol=0.1)


def test_nothing_is_born_outside_the_area() -> None:
    prior, z = Undetected.uniform(AREA, (33, 33), 5.0), np.array([[60.0, 0.0]])  # right on the border
    x, w = detected(
        prior,
        SENSOR,
        POSE,
        z,
        explanations(prior, SENSOR, POSE, z),
        np.ones(1),
        np.array([500]),
        np.random.default_rng(0),
    )
    assert (x[0] <= 100.0).all()
    assert w.sum() == pytest.approx(1.0)


def test_a_measurement_from_beyond_the_area_explains_nothing() -> None:
    prior = Undetected.uniform(AREA, (33, 33), 5.0)
    assert explanations(prior, SENSOR, POSE, np.array([[90.0, 0.0]])).totals[0] == 0.0


def test_mass_is_the_prior_and_grows_by_births_and_shrinks_by_survival() -> None:
    prior = Undetected.uniform(AREA, (7, 9), 5.0)
    assert prior.mass() == pytest.approx(5.0)
    assert prior.later(0.5, 0.25).mass() == pytest.approx(2.75)


def test_a_look_takes_away_what_it_would_have_seen() -> None:
    prior = Undetected.uniform(AREA, (5, 5), 5.0)
    after = prior.after(SENSOR, POSE)
    seen = SENSOR.detection(prior.nodes(), POSE[None])[0]
    assert np.allclose(after.values.ravel(), prior.values.ravel() * (1 - seen))
