"""Known objects in the clutter intensity."""

import numpy as np
import pytest

from estimator.filter import Area
from estimator.sensors.known import WithKnown
from estimator.sensors.range_bearing import RangeBearing

AREA = Area(np.zeros(2), np.full(2, 10.0))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=0.3,
        bearing_sigma_deg=4.0,
        clutter=0.5,
        field_of_view="sector",
        range_m=9.0,
        angle_deg=90.0,
        gain=0.6,
    ),
    AREA,
)
POSE = np.array([1.0, 1.0, 0.0, 0.7])


def known(*positions: tuple[float, float], spread: float = 0.2, rate: float = 1.0) -> WithKnown:
    k = len(positions)
    return WithKnown(
        SENSOR, np.array(positions, dtype=float).reshape(k, 2).T, np.full(k, spread), np.full(k, rate)
    )


def test_without_known_objects_the_look_is_the_sensors_own() -> None:
    points = np.array([[4.0, 5.0], [4.0, 5.0]])
    z = SENSOR.measure(points, POSE)
    assert np.array_equal(known().look(points, POSE, z).clutter, SENSOR.look(points, POSE, z).clutter)


@pytest.mark.parametrize("spread", [0.05, 0.15, 0.3])
def test_clutter_at_an_object_is_its_density_blurred_by_its_spread(spread: float) -> None:
    position = np.array([5.0, 4.0])
    z = SENSOR.measure(position[:, None], POSE) + np.array([[0.2, -0.03]])
    rng = np.random.default_rng(1)
    drawn = position[:, None] + spread * rng.standard_normal((2, 200_000))
    look = SENSOR.look(drawn, POSE, z)
    expected = look.clutter[0] + look.likelihood.sum() / drawn.shape[1]
    found = known((5.0, 4.0), spread=spread).look(drawn[:, :1], POSE, z).clutter[0]
    assert found == pytest.approx(expected, rel=0.05)


def test_rates_of_several_objects_add_up() -> None:
    z = SENSOR.measure(np.array([[5.0], [4.0]]), POSE)
    points = np.zeros((2, 0))
    own = SENSOR.look(points, POSE, z).clutter
    one = known((5.0, 4.0)).look(points, POSE, z).clutter - own
    three = known((5.0, 4.0), (5.0, 4.0), (1.0, 9.0), rate=1.5).look(points, POSE, z).clutter - own
    assert three == pytest.approx(3.0 * one, rel=1e-12)


def test_what_is_far_from_every_object_keeps_its_clutter() -> None:
    z = SENSOR.measure(np.array([[8.0], [8.0]]), POSE)
    points = np.zeros((2, 0))
    assert np.array_equal(
        known((3.0, 2.0)).look(points, POSE, z).clutter, SENSOR.look(points, POSE, z).clutter
    )


def test_detection_and_likelihood_stay_the_sensors() -> None:
    points = np.array([[4.0, 5.0, 6.0], [4.0, 5.0, 3.0]])
    z = SENSOR.measure(points, POSE)
    ours, own = known((5.0, 5.0)).look(points, POSE, z), SENSOR.look(points, POSE, z)
    assert np.array_equal(ours.detection, own.detection)
    assert np.array_equal(ours.likelihood, own.likelihood)


def test_positions_of_the_wrong_dimension_are_refused() -> None:
    wrong = WithKnown(SENSOR, np.zeros((3, 1)), np.ones(1), np.ones(1))
    with pytest.raises(ValueError, match="points"):
        wrong.look(np.zeros((2, 1)), POSE, np.array([[3.0, 0.0]]))
