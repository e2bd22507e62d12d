"""Softmax models of relations, against geometry."""

import numpy as np
import pytest

from estimator.arrays import BoolArray, FloatArray
from estimator.soft.models import SoftModel, directions, ranges, region, wall

RNG = np.random.default_rng(0)
POINTS: FloatArray = RNG.uniform(-7.0, 7.0, (2, 4000))
L_SHAPE = np.array([[-4.0, -4.0], [4.0, -4.0], [4.0, -1.0], [-1.0, -1.0], [-1.0, 4.0], [-4.0, 4.0]])
STAR = np.array([[(5 - 3 * (i % 2)) * f(np.pi * i / 5) for f in (np.cos, np.sin)] for i in range(10)])


def said(model: SoftModel, name: str, points: FloatArray = POINTS) -> FloatArray:
    return model.softmax.probabilities(points)[model.category(name)]


def winds_around(corners: FloatArray, points: FloatArray) -> BoolArray:
    """Whether a polygon (k, 2) winds around points (2, n): the angles to its corners add up to a full turn.

    The code under test counts the edges that a ray crosses: this is another way.
    """
    arms = corners[:, :, None] - points[None]
    after = np.roll(arms, -1, axis=0)
    cross = arms[:, 0] * after[:, 1] - arms[:, 1] * after[:, 0]
    turns = np.arctan2(cross, np.sum(arms * after, axis=1)).sum(axis=0)
    return np.asarray(np.abs(turns) > np.pi)


def distance_to_edges(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Metres (n,) from points (2, n) to the nearest edge of a polygon (k, 2)."""
    edges = np.roll(corners, -1, axis=0) - corners
    steps = points[None] - corners[:, :, None]
    share = np.einsum("ka,kan->kn", edges, steps) / np.sum(edges**2, axis=1)[:, None]
    nearest = edges[:, :, None] * np.clip(share, 0.0, 1.0)[:, None]
    return np.asarray(np.linalg.norm(steps - nearest, axis=1).min(axis=0))


def test_ranges_are_the_papers_seventeen_sub_classes() -> None:
    model = ranges(np.zeros(2), 2.0, 4.0, 4.0)
    assert np.bincount(model.softmax.class_of).tolist() == [1, 8, 8]


def test_near_around_and_far_from_follow_the_distance() -> None:
    place = np.array([1.0, -0.5])
    model = ranges(place, 2.0, 4.0, 30.0)
    r = np.linalg.norm(POINTS - place[:, None], axis=0)
    assert (said(model, "near")[r < 1.85] > 0.95).all()
    assert (said(model, "around")[(r > 2.3) & (r < 3.75)] > 0.95).all()
    assert (said(model, "far from")[r > 4.4] > 0.95).all()


@pytest.mark.parametrize("corners", [L_SHAPE, STAR, L_SHAPE[::-1], np.array([[0, 0], [3, 1], [-2, 5.0]])])
def test_inside_is_inside_for_any_simple_polygon(corners: FloatArray) -> None:
    model = region(corners, 80.0)
    p = said(model, "inside")
    inside = winds_around(corners, POINTS)
    away = distance_to_edges(corners, POINTS) > 0.15
    assert away.mean() > 0.8
    np.testing.assert_array_equal(p[away] > 0.5, inside[away])
    np.testing.assert_allclose(said(model, "outside") + p, 1.0)


def test_steepness_is_the_slope_of_the_log_odds_at_an_edge() -> None:
    model = region(L_SHAPE, 3.0)
    x = np.array([[3.9, 4.1], [-2.5, -2.5]])
    p = said(model, "inside", x)
    odds = np.log(p / (1.0 - p))
    assert odds[0] - odds[1] == pytest.approx(0.6, rel=0.03)
    assert odds.mean() == pytest.approx(0.0, abs=0.06)  # the other edges are 1.5 m away


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.9])
def test_directions_are_quadrants_about_the_robots_yaw(yaw: float) -> None:
    model = directions(np.array([1.0, 2.0, 0.0, yaw]), 40.0)
    step = POINTS - np.array([[1.0], [2.0]])
    angle = (np.arctan2(step[1], step[0]) - yaw + np.pi) % (2 * np.pi) - np.pi
    far = np.linalg.norm(step, axis=0) > 1.0
    for name, middle in (("in front of", 0.0), ("left of", np.pi / 2), ("right of", -np.pi / 2)):
        near = (np.abs(angle - middle) < 0.6) & far
        assert (said(model, name)[near] > 0.95).all()
    assert (said(model, "behind")[(np.abs(angle) > 2.5) & far] > 0.95).all()


def test_reach_leaves_what_is_far_elsewhere() -> None:
    model = directions(np.array([0.0, 0.0, 0.0, 0.0]), 20.0, reach=3.0)
    x = np.array([[2.0, 5.0], [0.0, 0.0]])
    assert said(model, "in front of", x) == pytest.approx([1.0, 0.0], abs=1e-3)
    assert said(model, "elsewhere", x) == pytest.approx([0.0, 1.0], abs=1e-3)


def test_a_walls_front_is_to_the_left_of_who_walks_it_and_left_is_beyond_its_end() -> None:
    model = wall(np.array([-2.0, 0.0]), np.array([2.0, 0.0]), 20.0, reach=4.0)
    x = np.array([[0.0, 0.0, 3.5, -3.5, 0.0], [1.0, -1.0, 0.3, 0.3, 6.0]])
    names = ["in front of", "behind", "left of", "right of", "elsewhere"]
    for i, name in enumerate(names):
        assert said(model, name, x)[i] > 0.99


@pytest.mark.parametrize("dimension", [2, 3])
def test_height_does_not_matter(dimension: int) -> None:
    model = ranges(np.zeros(2), 1.0, 2.0, 5.0, dimension=dimension)
    x = np.vstack([POINTS[:, :9], np.linspace(-9, 9, 9)])[:dimension]
    np.testing.assert_allclose(
        said(model, "near", x), said(ranges(np.zeros(2), 1.0, 2.0, 5.0), "near", x[:2])
    )


def test_models_turn_and_move_with_their_references() -> None:
    c, s = np.cos(0.8), np.sin(0.8)
    turn, shift = np.array([[c, -s], [s, c]]), np.array([3.0, -1.0])
    moved = region(L_SHAPE @ turn.T + shift, 4.0)
    p = said(moved, "inside", turn @ POINTS + shift[:, None])
    np.testing.assert_allclose(p, said(region(L_SHAPE, 4.0), "inside"), atol=1e-9)


BOW_TIE = np.array([[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0], [-1.0, 1.5]])
COMB = np.array([[0.0, -1.0]] + [[0.1 * i, (i % 2) * (1.0 + 0.01 * i**2)] for i in range(21)] + [[2.0, -1.0]])


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: ranges(np.array([np.nan, 0.0]), 1.0, 2.0, 1.0), "place"),
        (lambda: ranges(np.zeros(2), 2.0, 2.0, 1.0), "inner, outer"),
        (lambda: ranges(np.zeros(2), 1.0, 2.0, 0.0), "steepness"),
        (lambda: ranges(np.zeros(2), 1.0, 2.0, 1.0, dimension=4), "dimension"),
        (lambda: region(np.zeros((2, 2)), 1.0), "corners"),
        (lambda: region(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), 1.0), "corners"),
        (lambda: region(np.full((3, 2), np.inf), 1.0), "corners"),
        (lambda: region(BOW_TIE, 1.0), "cross"),
        (lambda: region(COMB, 1.0), "simplify"),
        (lambda: directions(np.zeros(3), 1.0), "pose"),
        (lambda: directions(np.zeros(4), 1.0, reach=-1.0), "reach"),
        (lambda: wall(np.zeros(2), np.zeros(2), 1.0), "end"),
        (lambda: ranges(np.zeros(2), 1.0, 2.0, 1.0).category("above"), "relation"),
    ],
)
def test_what_makes_no_model_is_named(make: object, argument: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=argument):
        make()
