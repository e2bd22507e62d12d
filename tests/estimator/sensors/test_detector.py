"""The detector: the triangle of Ponda et al. 2012 fig. 4, kinds of detection, tables."""

from typing import Any

import numpy as np
import pytest

from estimator.filter import Area
from estimator.sensors.detector import Detector, SoftmaxTable

POSE = np.array([5.0, 4.0, 2.0, 0.0])


def detector(d: int = 2, **table: Any) -> Detector:
    return Detector.of(Detector.Config(period_s=1.0, **table), Area(np.zeros(d), np.full(d, 30.0)))


def test_the_papers_camera_sees_a_triangle_ahead_with_three_classes_for_not_seeing() -> None:
    sensor = detector(range_m=8.0, angle_deg=90.0, steepness=5.0)
    assert sensor.softmax.class_of.tolist() == [0, 0, 0, 1]
    local = np.array([[4.0, 7.5, 4.0, 8.5, 3.0, -2.0], [0.0, 6.0, 4.0, 0.0, -5.0, 0.0]])
    seen = sensor.detection(local + POSE[:2, None], POSE)[0]
    assert seen[:2] == pytest.approx([1.0, 0.9], abs=0.1)
    assert seen[2] == pytest.approx(0.5, abs=1e-6)  # on the triangle's edge
    assert (seen[3:] < 0.1).all()


def test_a_camera_in_three_dimensions_sees_a_pyramid() -> None:
    sensor = detector(3, range_m=8.0, angle_deg=90.0, height_angle_deg=30.0, steepness=5.0)
    local = np.array([[5.0, 5.0, 5.0], [0.0, 0.0, 3.0], [0.0, 3.0, 0.0]])
    assert sensor.detection(local + POSE[:3, None], POSE)[0] == pytest.approx([1.0, 0.0, 1.0], abs=0.01)


def test_every_target_gives_one_category_at_most_and_its_kind_says_where_it_is() -> None:
    near_or_far = SoftmaxTable(
        weights=[[0.0, 0.0], [0.0, 0.0], [2.0, 0.0]], biases=[-4.0, 0.0, -10.0], categories=[0, 1, 2]
    )
    sensor = detector(softmax=near_or_far, max_range_m=10.0, gain=0.8, clutter=0.5)
    points = POSE[:2, None] + np.array([[2.0, 8.0], [0.0, 0.0]])
    look = sensor.look(points, POSE, np.array([[1.0], [2.0]]))
    g = look.likelihood.reshape(2, 2)
    assert g.sum(axis=0) == pytest.approx([1.0, 1.0])
    assert g[0, 0] > 0.99 < g[1, 1]
    assert look.clutter.tolist() == [0.25, 0.25]
    near, far = sensor.locate(np.array([[1.0], [2.0]]), POSE)[0]
    assert near < POSE[0] + 2.0 < POSE[0] + 6.0 < far


@pytest.mark.parametrize("z", [0.0, 2.0, 1.5, -1.0, 1e300])
def test_what_is_no_category_never_happens(z: float) -> None:
    sensor = detector(range_m=8.0, angle_deg=90.0, clutter=0.5)
    look = sensor.look(POSE[:2, None] + 1.0, POSE, np.array([[z], [1.0]]))
    assert look.offsets.tolist() == [0, 0, 1]
    assert look.clutter.tolist() == [0.0, 0.5]


SMALL = {"weights": [[0.0, 0.0], [1.0, 0.0]], "biases": [0.0, 0.0], "categories": [0, 1]}


@pytest.mark.parametrize(
    ("d", "table", "key"),
    [
        (2, {}, "range_m"),
        (2, {"range_m": 5.0}, "angle_deg"),
        (3, {"range_m": 5.0, "angle_deg": 30.0}, "height_angle_deg"),
        (2, {"range_m": 5.0, "softmax": SMALL}, "softmax"),
        (3, {"softmax": SMALL}, "weights needs 3 numbers"),
        (2, {"softmax": {**SMALL, "biases": [0.0]}}, "softmax: biases"),
        (2, {"softmax": {**SMALL, "categories": [0, 0]}}, "softmax: needs a category 1"),
        (2, {"softmax": {**SMALL, "biases": [0.0, -1e4]}}, "softmax: a category is detected nowhere"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_by_key(d: int, table: dict[str, Any], key: str) -> None:
    if "softmax" in table:
        table = {**table, "softmax": SoftmaxTable(**table["softmax"])}
    with pytest.raises(ValueError, match=key):
        detector(d, **table)
