"""The grid of the ground against exact geometry, scipy's graphs and brute force."""

import itertools

import numpy as np
import pytest
import scipy.ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from estimator.filter import Area
from planner.ground.build import GroundPlan, built
from planner.ground.frame import MARGIN, OPEN, SOLID, TIGHT
from planner.ground.grid_ground import GridGround
from planner.ground.shapes import Shape
from planner.ground.walk import chebyshev3, squared_distances

AREA = Area(np.zeros(2), np.array([20.0, 10.0]))
START = np.array([[1.0], [5.0], [0.0]])
BOX = np.array([[8.0, 2.0], [12.0, 2.0], [12.0, 8.0], [8.0, 8.0]])


def grid(cells: np.ndarray, **more: float) -> GridGround:
    layers = cells if cells.ndim == 3 else cells[None]
    return GridGround(np.ascontiguousarray(layers.astype(np.uint8)), 1.0, np.zeros(3), **more)  # type: ignore[arg-type]


def random_cells(seed: int, rows: int = 12, columns: int = 15, share: float = 0.25) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.where(rng.random((rows, columns)) < share, SOLID, OPEN)


def free_line(cells: np.ndarray, a: np.ndarray, b: np.ndarray) -> bool:
    """Whether no blocked cell's square, closed, meets a segment: by clipping at every one."""
    step = b - a
    for row, column in np.argwhere(cells == SOLID):
        low, high = 0.0, 1.0
        for axis, corner in ((0, column), (1, row)):
            if step[axis] == 0:
                if not corner - 1e-9 <= a[axis] <= corner + 1 + 1e-9:
                    low, high = 1.0, 0.0
            else:
                t = sorted(
                    ((corner - 1e-9 - a[axis]) / step[axis], (corner + 1 + 1e-9 - a[axis]) / step[axis])
                )
                low, high = max(low, t[0]), min(high, t[1])
        if low <= high:
            return False
    return True


def exact_length(cells: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """The shortest way through the middles of cells at any angle: all lines of sight, then Dijkstra."""
    middles = np.argwhere(cells == OPEN)[:, ::-1] + 0.5
    nodes = np.vstack([a, b, middles])
    rows, columns, lengths = [], [], []
    for i, j in itertools.combinations(range(len(nodes)), 2):
        if free_line(cells, nodes[i], nodes[j]):
            rows.append(i)
            columns.append(j)
            lengths.append(np.linalg.norm(nodes[i] - nodes[j]))
    graph = coo_matrix((lengths, (rows, columns)), shape=(len(nodes), len(nodes)))
    return float(dijkstra(graph.tocsr(), directed=False, indices=0)[1])


def octile(cells: np.ndarray, source: tuple[int, int]) -> np.ndarray:
    """Dijkstra of scipy over the eight neighbours, corners not cut: an upper bound, and who is connected."""
    rows_, columns_ = cells.shape
    index = np.arange(cells.size).reshape(cells.shape)
    free = cells == OPEN
    i, j, w = [], [], []
    for dj, di in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for r in range(rows_ - dj):
            for c in range(max(0, -di), min(columns_, columns_ - di)):
                if free[r, c] and free[r + dj, c + di] and free[r + dj, c] and free[r, c + di]:
                    i.append(index[r, c])
                    j.append(index[r + dj, c + di])
                    w.append(np.hypot(di, dj))
    graph = coo_matrix((w, (i, j)), shape=(cells.size, cells.size)).tocsr()
    return np.asarray(dijkstra(graph, directed=False, indices=index[source])).reshape(cells.shape)


@pytest.mark.parametrize("seed", range(6))
def test_segments_are_clear_exactly_where_no_blocked_cell_is_touched(seed: int) -> None:
    cells = random_cells(seed, share=0.15)
    ground = grid(cells)
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, [[15], [12]], (2, 300)), rng.uniform(0, [[15], [12]], (2, 300))
    a[:, ::3] = np.floor(a[:, ::3]) + 0.5  # from middle to middle corners are met exactly
    b[:, ::3] = np.floor(b[:, ::3]) + 0.5
    expected = [free_line(cells, p, q) for p, q in zip(a.T, b.T, strict=True)]
    np.testing.assert_array_equal(ground.segments_clear(a, b), expected)
    np.testing.assert_array_equal(ground.segments_clear(b, a), expected)


def test_ways_are_nearly_as_short_as_the_shortest_through_middles_of_cells() -> None:
    """Lazy Theta* is not optimal: in these mazes of single cells it loses 3% on average, never 8%."""
    lost = []
    a, b = np.array([0.5, 0.5]), np.array([9.5, 8.5])
    for seed in range(7):
        cells = random_cells(seed, 9, 10)
        cells[0, 0] = cells[8, 9] = OPEN
        ground = grid(cells)
        way, exact = ground.path(a, b), exact_length(cells, a, b)
        swept, far = ground.paths(a, b[:, None])[0], ground.distances(b, a[:, None])[0]
        if way is None or swept is None:
            assert np.isinf([exact, far]).all()
            continue
        assert ground.segments_clear(way[:, :-1], way[:, 1:]).all()
        np.testing.assert_array_equal(way[:, [0, -1]], np.stack([a, b], axis=1))
        for length in (legs(way), legs(swept), far):
            assert exact - 1e-9 <= length <= 1.08 * exact
            lost.append(length / exact - 1.0)
    assert len(lost) > 12
    assert np.mean(lost) < 0.04


@pytest.mark.parametrize("seed", range(3))
def test_a_search_whose_time_is_up_knows_what_is_near_and_goes_on_when_asked_again(seed: int) -> None:
    cells = random_cells(seed, 80, 90, 0.15)
    cells[40, 45] = OPEN
    ground, whole, here = grid(cells), grid(cells), np.array([45.5, 40.5])
    rows, columns = np.nonzero(cells == OPEN)
    middles = np.stack([columns + 0.5, rows + 0.5])
    asked = iter([False, True] + [True] * 10)
    some, exact = ground.distances(here, middles, lambda: next(asked)), whole.distances(here, middles)
    known = np.isfinite(some)
    assert 500 < known.sum() < np.isfinite(exact).sum()
    assert np.median(exact[known]) < np.median(exact[np.isfinite(exact) & ~known])
    assert ground.path(here, middles[:, -1], lambda: True) is None
    np.testing.assert_array_equal(ground.distances(here, middles), exact)


def test_ways_to_many_goals_are_those_to_each() -> None:
    cells = random_cells(5, 40, 50, 0.2)
    cells[20, 25] = OPEN
    ground, here = grid(cells), np.array([25.5, 20.5])
    goals = np.random.default_rng(5).uniform([[0], [0]], [[50], [40]], (2, 200))
    for goal, way in zip(goals.T, ground.paths(here, goals), strict=True):
        alone = ground.path(here, goal)
        assert (way is None) == (alone is None)
        if way is not None and alone is not None:
            assert ground.segments_clear(way[:, :-1], way[:, 1:]).all()
            np.testing.assert_array_equal(way[:, [0, -1]], np.stack([here, goal], axis=1))
            assert legs(way) == pytest.approx(legs(alone), rel=0.08)


def test_on_layers_lines_are_open_as_on_one() -> None:
    """The fast walk on one layer and the general one agree."""
    cells = random_cells(2, share=0.15).astype(np.uint8)
    flat, layers = grid(cells), grid(np.repeat(cells[None], 2, axis=0), low=0.0, high=2.0)
    rng = np.random.default_rng(2)
    a, b = rng.uniform(0, [[15], [12]], (2, 500)), rng.uniform(0, [[15], [12]], (2, 500))
    level = np.full((1, 500), 0.5)
    over_two = layers.segments_clear(np.vstack([a, level]), np.vstack([b, level]))
    np.testing.assert_array_equal(flat.segments_clear(a, b), over_two)


def legs(way: np.ndarray) -> float:
    """Its length."""
    return float(np.linalg.norm(np.diff(way), axis=0).sum())


@pytest.mark.parametrize("seed", range(4))
def test_distances_lie_between_the_straight_line_and_the_way_over_neighbours(seed: int) -> None:
    cells = random_cells(seed, 40, 50, 0.2)
    cells[20, 25] = OPEN
    ground, goal = grid(cells), np.array([25.5, 20.5])
    rows, columns = np.indices(cells.shape)
    middles = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5])
    found = ground.distances(goal, middles).reshape(cells.shape)
    over_neighbours = octile(cells, (20, 25))
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(over_neighbours))
    there = np.isfinite(found)
    straight = np.linalg.norm(middles - goal[:, None], axis=0).reshape(cells.shape)
    assert (found[there] >= straight[there] - 1e-9).all()
    assert (found[there] <= over_neighbours[there] * (1 + 1e-9)).all()
    assert found[there].sum() < 0.99 * over_neighbours[there].sum()


@pytest.mark.parametrize("resolution", [0.4, 0.2, 0.1])
def test_the_way_around_a_box_is_the_visibility_graphs_up_to_the_grids_width(resolution: float) -> None:
    plan = GroundPlan(obstacles=(Shape.polygon([BOX]),), resolution=resolution)
    ground = built(plan, AREA, START)
    way = ground.path(np.array([1.0, 5.0]), np.array([19.0, 5.0]))
    assert way is not None
    exact = 2 * np.hypot(7.0, 3.0) + 4.0  # over the box's two corners on one side
    assert exact <= np.linalg.norm(np.diff(way), axis=0).sum() <= exact + 2.0 * resolution


@pytest.mark.parametrize("seed", range(3))
def test_no_clear_point_is_nearer_to_a_shape_than_the_radius_and_little_is_lost(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = (Shape.polygon([BOX]), Shape.disc(15.0, 4.0, 1.5))
    fence = Shape.polygon([np.array([[0.0, 0.0], [20.0, 1.0], [18.0, 10.0], [1.0, 9.0]])])
    plan = GroundPlan(obstacles=shapes[:1], keep_out=shapes[1:], fences=(fence,), radius=0.4, resolution=0.1)
    ground = built(plan, AREA, START)
    points = rng.uniform([[-2], [-2]], [[22], [12]], (2, 20000))
    gap = np.minimum(np.min([shape.distances(points) for shape in shapes], axis=0), -fence.distances(points))
    clear = ground.clear(points)
    assert (gap[clear] >= 0.4).all()
    assert clear[gap > 0.4 + 1.5 * 0.1 * np.sqrt(2)].all()


def test_inflation_is_the_exact_distance_transform() -> None:
    rng = np.random.default_rng(0)
    free = rng.random((60, 83)) < 0.97
    expected = scipy.ndimage.distance_transform_edt(free)
    np.testing.assert_allclose(np.sqrt(squared_distances(free)), expected, rtol=0, atol=1e-12)
    assert np.isinf(squared_distances(np.ones((4, 5), dtype=bool))).all()


def test_kings_moves_in_three_dimensions_are_scipys() -> None:
    blocked = np.random.default_rng(1).random((6, 20, 30)) < 0.01
    expected = scipy.ndimage.distance_transform_cdt(~blocked, "chessboard")
    np.testing.assert_array_equal(chebyshev3(blocked.astype(np.uint8)), expected)


def test_layers_let_robots_over_what_is_low_and_under_what_is_high() -> None:
    box = Area(np.zeros(3), np.array([20.0, 10.0, 12.0]))
    wall = np.array([[9.0, -5.0], [11.0, -5.0], [11.0, 15.0], [9.0, 15.0]])
    plan = GroundPlan(obstacles=(Shape.polygon([wall], (0.0, 6.0)),), resolution=0.5, radius=0.3)
    ground = built(plan, box, np.array([[1.0], [5.0], [1.0]]))
    inside, over = np.array([[10.0], [5.0], [3.0]]), np.array([[10.0], [5.0], [8.0]])
    assert not ground.clear(inside)[0]
    assert ground.clear(over)[0]
    assert not ground.clear(inside[:2])[0]  # without an altitude: at any
    way = ground.path(np.array([1.0, 5.0, 2.0]), np.array([19.0, 5.0, 2.0]))
    assert way is not None
    assert way[2].max() >= 6.3
    assert ground.segments_clear(way[:, :-1], way[:, 1:]).all()
    high = ground.path(np.array([1.0, 5.0, 8.0]), np.array([19.0, 5.0, 8.0]))
    assert high is not None
    assert high.shape == (3, 2)


def test_ways_stay_at_their_altitude_unless_there_is_none_or_they_may_climb() -> None:
    box = Area(np.zeros(3), np.array([20.0, 40.0, 6.0]))
    wall = np.array([[9.0, 2.0], [11.0, 2.0], [11.0, 45.0], [9.0, 45.0]])
    ends = np.array([3.0, 20.0, 1.0]), np.array([17.0, 20.0, 1.0])
    for climb in (False, True):
        plan = GroundPlan(obstacles=(Shape.polygon([wall], (0.0, 3.0)),), resolution=0.5, climb=climb)
        way = built(plan, box, ends[0][:, None]).path(*ends)
        assert way is not None
        assert (way[2].max() > 3.0) == climb


def test_altitude_limits_hold_on_flat_ground_too() -> None:
    ground = built(GroundPlan(altitude=(2.0, 30.0), resolution=0.5), AREA, START)
    points = np.array([[5.0, 5.0, 5.0], [5.0, 5.0, 5.0], [1.0, 10.0, 31.0]])
    np.testing.assert_array_equal(ground.clear(points), [False, True, False])
    assert ground.clear(points[:2]).all()


def test_what_stands_too_near_leaves_by_the_nearest_clear_place_and_what_stands_inside_does_not() -> None:
    plan = GroundPlan(obstacles=(Shape.polygon([BOX]),), radius=0.5, resolution=0.1)
    ground = built(plan, AREA, START)
    near, inside, goal = np.array([7.8, 5.0]), np.array([10.0, 5.0]), np.array([1.0, 5.0])
    assert not ground.clear(near[:, None])[0]
    way = ground.path(near, goal)
    assert way is not None
    np.testing.assert_array_equal(way[:, 0], near)
    assert ground.clear(way[:, 1:]).all()
    assert np.linalg.norm(way[:, 1] - near) < 0.6
    assert np.isfinite(ground.distances(goal, near[:, None]))[0]
    assert ground.path(inside, goal) is None
    assert ground.path(goal, near) is None
    assert np.isinf(ground.distances(goal, inside[:, None]))[0]


def test_ways_keep_room_where_there_is_any_and_take_the_narrow_door_where_there_is_none() -> None:
    cells = np.zeros((20, 40), dtype=np.uint8)
    cells[:, 20] = SOLID
    cells[9:11, 20] = TIGHT  # a narrow door
    cells[2, 20] = OPEN  # a wide one, further
    ground = GridGround(cells[None], 1.0, np.zeros(3), reach=2.0)
    a, b = np.array([10.5, 10.5]), np.array([30.5, 10.5])
    straight = ground.path(a, b)
    assert straight is not None
    assert straight.shape == (2, 2)  # a clear straight way is taken
    low = ground.path(np.array([10.5, 4.5]), np.array([30.5, 6.5]))
    assert low is not None
    assert low[1].min() < 3.0
    cells[2, 20] = SOLID
    narrow = GridGround(cells[None], 1.0, np.zeros(3), reach=2.0)
    assert narrow.path(np.array([10.5, 4.5]), np.array([30.5, 6.5])) is not None


@pytest.mark.parametrize(
    "points",
    [np.full((2, 1), np.nan), np.full((2, 1), np.inf), np.full((2, 1), 1e300), np.full((3, 1), np.nan)],
)
def test_places_that_are_none_are_not_clear_and_no_way_leads_there(points: np.ndarray) -> None:
    ground = built(GroundPlan(obstacles=(Shape.disc(10.0, 5.0, 1.0),)), AREA, START)
    here = START[: len(points), 0].copy()
    assert not ground.clear(points)[0]
    assert not ground.segments_clear(points, points)[0]
    assert ground.path(here, points[:, 0]) is None
    assert ground.path(points[:, 0], here) is None
    assert np.isinf(ground.distances(here, points))[0]
    assert ground.clear(np.zeros((2, 0))).shape == (0,)
    assert ground.paths(here, np.zeros((len(here), 0))) == []


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("within", [0.5, 4.0, 9.0, 1e3])
def test_distances_within_a_bound_are_those_without_one(seed: int, within: float) -> None:
    cells = random_cells(seed, 30, 40, 0.2)
    cells[0, 0] = OPEN
    places = np.random.default_rng(seed).uniform(0, [[40], [30]], (2, 400))
    source = np.array([0.5, 0.5])
    places[:, 0] = source
    whole = grid(cells).distances(source, places)
    some = grid(cells).distances(source, places, within=within)
    np.testing.assert_array_equal(some, np.where(whole <= within, whole, np.inf))
    assert some[0] == 0.0


def test_the_same_question_has_the_same_answer_whatever_was_asked_before() -> None:
    plan = GroundPlan(obstacles=(Shape.polygon([BOX]),), resolution=0.2)
    asked, fresh = built(plan, AREA, START), built(plan, AREA, START)
    rng = np.random.default_rng(0)
    points = rng.uniform([[0], [0]], [[20], [10]], (2, 50))
    for goal in points[:, asked.clear(points)].T[:20]:
        asked.distances(goal, points)
    goal = np.array([19.0, 5.0])
    np.testing.assert_array_equal(asked.distances(goal, points), fresh.distances(goal, points))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"cells": np.zeros((2, 2), np.uint8)}, "cells"),
        ({"resolution": 0.0}, "resolution"),
        ({"origin": np.array([0.0, np.nan, 0.0])}, "origin"),
        ({"low": 3.0, "high": 2.0}, "low"),
        ({"cells": np.zeros((2, 2, 2), np.uint8)}, "low, high"),
    ],
)
def test_a_wrong_grid_is_named(change: dict[str, object], named: str) -> None:
    right = {"cells": np.zeros((1, 2, 2), np.uint8), "resolution": 1.0, "origin": np.zeros(3)}
    with pytest.raises(ValueError, match=named):
        GridGround(**{**right, **change})  # type: ignore[arg-type]


def test_too_fine_a_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="resolution_m"):
        built(GroundPlan(resolution=1e-4), AREA, START)


def test_margins_are_between_solid_and_clear() -> None:
    plan = GroundPlan(obstacles=(Shape.disc(10.0, 5.0, 2.0),), radius=0.5, room=0.5, resolution=0.1)
    row = built(plan, AREA, START).states(np.stack([np.linspace(10, 20, 1001), np.full(1001, 5.0)]))
    changes = row[np.flatnonzero(np.diff(row.astype(int))) + 1]
    assert changes.tolist()[:3] == [MARGIN, TIGHT, OPEN]
