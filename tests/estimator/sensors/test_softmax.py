"""Multimodal softmax against scipy, finite differences and geometry."""

from typing import Any

import numpy as np
import pytest
from scipy.special import log_softmax, logsumexp

from estimator.sensors.softmax import Softmax


def model(seed: int, d: int = 2, k: int = 17, c: int = 3) -> Softmax:
    rng = np.random.default_rng(seed)
    classes = np.append(np.arange(c), rng.integers(0, c, k - c))
    return Softmax(rng.normal(0.0, 2.0, (k, d)), rng.normal(0.0, 5.0, k), classes)


@pytest.mark.parametrize("seed", range(8))
def test_probabilities_are_equation_22(seed: int) -> None:
    d = 1 + seed % 3
    softmax, rng = model(seed, d), np.random.default_rng(seed)
    points = rng.normal(0.0, 4.0, (d, 700))
    each = log_softmax(softmax.weights @ points + softmax.biases[:, None], axis=0)
    expected = np.stack([logsumexp(each[softmax.class_of == c], axis=0) for c in range(3)])
    np.testing.assert_allclose(softmax.probabilities(points), np.exp(expected), rtol=1e-9, atol=1e-300)
    np.testing.assert_allclose(softmax.probabilities(points).sum(axis=0), 1.0, rtol=1e-12)
    for c in range(3):
        np.testing.assert_allclose(softmax.log_probability(points, c), expected[c], rtol=1e-9, atol=1e-9)


def test_a_probability_that_underflows_keeps_its_logarithm() -> None:
    softmax = Softmax(np.array([[1.0], [0.0]]), np.zeros(2), np.array([0, 1]))
    assert softmax.log_probability(np.array([[-1e5, 0.0, 1e5]]), 0) == pytest.approx([-1e5, -np.log(2), 0.0])


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("category", [0, 1, 2])
def test_gradient_and_hessian_are_the_slopes_of_the_logarithm(d: int, category: int) -> None:
    softmax, step = model(d, d), 1e-4
    points = np.random.default_rng(d).normal(0.0, 3.0, (d, 60))
    gradient, hessian = softmax.log_gradient(points, category), softmax.log_hessian(points, category)
    for a in range(d):
        off = step * np.eye(d)[:, [a]]
        rise = softmax.log_probability(points + off, category) - softmax.log_probability(
            points - off, category
        )
        np.testing.assert_allclose(gradient[a], rise / (2 * step), atol=1e-5)
        turn = softmax.log_gradient(points + off, category) - softmax.log_gradient(points - off, category)
        np.testing.assert_allclose(hessian[:, :, a].T, turn / (2 * step), atol=1e-4)


def test_a_polytope_is_probable_inside_and_even_at_its_faces() -> None:
    corner = Softmax.polytope(
        np.array([[-1.0, 0.0], [0.0, -1.0], [0.6, 0.8]]), np.array([0.0, 0.0, 6.0]), 8.0
    )
    inside, outside = np.array([[2.0, 1.0], [2.0, 4.0]]), np.array([[-2.0, 9.0], [1.0, 9.0]])
    assert (corner.probabilities(inside)[1] > 0.99).all()
    assert (corner.probabilities(outside)[1] < 1e-3).all()
    assert corner.probabilities(np.array([[0.0], [3.0]]))[1, 0] == pytest.approx(0.5, abs=1e-6)


def test_a_placed_model_sees_in_the_world_what_it_saw_in_the_robots_axes() -> None:
    softmax, pose = model(3, 3), np.array([4.0, -2.0, 1.0, 2.2])
    local = np.random.default_rng(3).normal(0.0, 2.0, (3, 30))
    c, s = np.cos(pose[3]), np.sin(pose[3])
    world = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ local + pose[:3, None]
    np.testing.assert_allclose(softmax.placed(pose).probabilities(world), softmax.probabilities(local))


def test_no_points_give_no_probabilities() -> None:
    none = np.zeros((2, 0))
    assert model(0).probabilities(none).shape == (3, 0)
    assert model(0).log_probability(none, 0).shape == (0,)
    assert model(0).log_hessian(none, 0).shape == (0, 2, 2)


GOOD: dict[str, Any] = {"weights": np.ones((2, 2)), "biases": np.zeros(2), "class_of": np.array([0, 1])}


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"weights": np.ones(2)}, "weights"),
        ({"weights": np.full((2, 2), np.nan)}, "weights"),
        ({"biases": np.zeros(3)}, "biases"),
        ({"biases": np.array([0.0, np.inf])}, "biases"),
        ({"class_of": np.array([0])}, "class_of"),
        ({"class_of": np.array([0, 2])}, "class_of"),
        ({"class_of": np.array([-1, 0])}, "class_of"),
    ],
)
def test_a_model_that_does_not_fit_is_refused_by_name(changes: dict[str, Any], name: str) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        Softmax(**{**GOOD, **changes})


def test_bad_arguments_are_refused_by_name() -> None:
    softmax = Softmax(**GOOD)
    with pytest.raises(ValueError, match="points: "):
        softmax.probabilities(np.zeros((3, 1)))
    with pytest.raises(ValueError, match="points: "):
        softmax.log_probability(np.array([[np.nan], [0.0]]), 0)
    with pytest.raises(ValueError, match="category: "):
        softmax.log_gradient(np.zeros((2, 1)), 2)
    with pytest.raises(ValueError, match="steepness: "):
        Softmax.polytope(np.eye(2), np.ones(2), 0.0)
    with pytest.raises(ValueError, match="offsets: "):
        Softmax.polytope(np.eye(2), np.ones(3), 1.0)
