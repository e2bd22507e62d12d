"""Occupancy maps: where cells lie in the world, what is free, what can be reached."""

from collections import deque

import numpy as np
import pytest

from estimator.arrays import FlagArray
from estimator.maps.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap

SEEDS = range(4)


def random_map(seed: int, rows: int = 23, columns: int = 37) -> OccupancyMap:
    rng = np.random.default_rng(seed)
    cells = rng.choice(3, size=(rows, columns), p=[0.7, 0.2, 0.1]).astype(np.uint8)
    return OccupancyMap(cells, 0.25, np.array([*rng.uniform(-5, 5, 2), rng.uniform(-np.pi, np.pi)]))


@pytest.mark.parametrize("seed", SEEDS)
def test_cells_and_world_are_each_others_inverse(seed: int) -> None:
    made = random_map(seed)
    points = np.random.default_rng(seed).uniform(-20, 20, (2, 50))
    np.testing.assert_allclose(made.to_world(made.to_cells(points)), points, atol=1e-12)
    rows, columns = np.indices(made.cells.shape)
    middles = made.to_world(np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5]))
    np.testing.assert_array_equal(made.at(middles), made.cells.ravel())


def test_a_cell_lies_where_the_maps_x_axis_points() -> None:
    cells = np.zeros((2, 3), np.uint8)
    cells[0, 2] = OCCUPIED  # 2.5 cells ahead, half a cell to the left
    made = OccupancyMap(cells, 2.0, np.array([10.0, 20.0, np.pi / 2]))
    assert made.at(np.array([[9.0], [25.0]])) == [OCCUPIED]
    low, high = made.bounds()
    np.testing.assert_allclose([low, high], [[6, 20], [10, 26]], atol=1e-12)


def test_outside_the_map_all_is_unknown_and_altitude_does_not_matter() -> None:
    made = OccupancyMap(np.zeros((2, 2), np.uint8), 1.0, np.zeros(3))
    points = np.array([[1.0, 2.0, -1e-9, 1e300], [1.0, 1.0, 1.0, 1.0], [99.0, 0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(made.at(points), [FREE, UNKNOWN, UNKNOWN, UNKNOWN])
    np.testing.assert_array_equal(made.is_free(points), [True, False, False, False])


@pytest.mark.parametrize("seed", SEEDS)
def test_free_points_are_a_grid_that_covers_free_space_evenly(seed: int) -> None:
    made = random_map(seed)
    fine = made.free_points(0.125)
    assert made.is_free(fine).all()
    assert fine.shape[1] == 4 * np.count_nonzero(made.cells == FREE)
    coarse = made.free_points(0.6)
    apart = np.linalg.norm(coarse[:, :, None] - coarse[:, None, :], axis=0)
    assert apart[apart > 0].min() == pytest.approx(0.6)


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf])
def test_a_spacing_that_is_none_is_named(spacing: float) -> None:
    with pytest.raises(ValueError, match="spacing"):
        random_map(0).free_points(spacing)


def flooded(cells: FlagArray, start: tuple[int, int]) -> FlagArray:
    """Breadth-first search, cell by cell."""
    reached, queue = {start}, deque([start])
    while queue:
        j, i = queue.popleft()
        for to in ((j + 1, i), (j - 1, i), (j, i + 1), (j, i - 1)):
            inside = 0 <= to[0] < cells.shape[0] and 0 <= to[1] < cells.shape[1]
            if inside and to not in reached and cells[to] == FREE:
                reached.add(to)
                queue.append(to)
    out = cells.copy()
    for at, state in np.ndenumerate(cells):
        if state == FREE and at not in reached:
            out[at] = UNKNOWN
    return out


@pytest.mark.parametrize("seed", SEEDS)
def test_what_no_way_leads_to_becomes_unknown(seed: int) -> None:
    made = random_map(seed)
    rows, columns = np.nonzero(made.cells == FREE)
    start = made.to_world(np.array([[columns[5] + 0.3], [rows[5] + 0.7]]))
    left = made.reachable_from(start)
    np.testing.assert_array_equal(left.cells, flooded(made.cells, (rows[5], columns[5])))
    nothing = made.reachable_from(made.to_world(np.array([[-5.0], [3.0]])))
    assert not (nothing.cells == FREE).any()


@pytest.mark.parametrize(
    ("cells", "resolution", "origin", "says"),
    [
        (np.zeros((0, 3), np.uint8), 1.0, np.zeros(3), "cells: expected uint8"),
        (np.zeros((3, 3)), 1.0, np.zeros(3), "cells: expected uint8"),
        (np.full((3, 3), 7, np.uint8), 1.0, np.zeros(3), "cells: expected 0"),
        (np.zeros((3, 3), np.uint8), 0.0, np.zeros(3), "resolution"),
        (np.zeros((3, 3), np.uint8), np.nan, np.zeros(3), "resolution"),
        (np.zeros((3, 3), np.uint8), 1.0, np.zeros(2), "origin"),
        (np.zeros((3, 3), np.uint8), 1.0, np.array([0.0, 0.0, np.inf]), "origin"),
    ],
)
def test_a_map_that_is_none_is_refused(
    cells: FlagArray, resolution: float, origin: np.ndarray, says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        OccupancyMap(cells, resolution, origin)
