"""Line of sight is exact: it agrees with rays sampled finely, and with the geometry of every cell."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_cdt

from estimator.arrays import BoolArray, FloatArray
from estimator.maps.occupancy import OCCUPIED, UNKNOWN, OccupancyMap
from estimator.maps.sight import Sight, chebyshev
from tests.estimator.maps.test_occupancy import random_map

SEEDS = range(6)


def sparse_map(seed: int) -> OccupancyMap:
    """Walls and poles with room between them, so that rays leap."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((41, 67), np.uint8)
    cells[rng.integers(0, 41, 12), rng.integers(0, 67, 12)] = OCCUPIED
    cells[rng.integers(0, 41), 10:30] = OCCUPIED
    cells[5:25, rng.integers(0, 67)] = OCCUPIED
    cells[rng.integers(0, 41), 50:60] = UNKNOWN
    return OccupancyMap(cells, 0.1, np.array([*rng.uniform(-5, 5, 2), rng.uniform(-np.pi, np.pi)]))


def crossed(ray: tuple[FloatArray, FloatArray], cell: tuple[int, int]) -> float:
    """How long a piece of the segment lies inside a cell's square, by clipping (Liang & Barsky)."""
    (u0, v0), (u1, v1) = ray
    first, last = 0.0, 1.0
    for start, step, low in ((u0, u1 - u0, cell[1]), (v0, v1 - v0, cell[0])):
        if step == 0.0:
            if not low <= start < low + 1:
                return 0.0
            continue
        a, b = sorted(((low - start) / step, (low + 1 - start) / step))
        first, last = max(first, a), min(last, b)
    return max(0.0, last - first) * float(np.hypot(u1 - u0, v1 - v0))


def seen_by_geometry(made: OccupancyMap, walls: BoolArray, pose: FloatArray, points: FloatArray) -> BoolArray:
    """Every wall's square is tried against every ray. Rays that graze a corner are right either way."""
    eye, ends = made.to_cells(pose[:, None])[:, 0], made.to_cells(points)
    own = tuple(np.floor(eye[::-1]).astype(int))
    out = np.ones(points.shape[1], dtype=bool)
    for k in range(points.shape[1]):
        goal = tuple(np.floor(ends[::-1, k]).astype(int))
        for cell in zip(*np.nonzero(walls), strict=True):
            if cell not in (own, goal) and crossed((eye, ends[:, k]), cell) > 1e-9:
                out[k] = False
                break
    return out


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("make", [random_map, sparse_map])
def test_a_point_is_seen_exactly_if_no_wall_is_crossed(make: object, seed: int) -> None:
    made: OccupancyMap = make(seed)  # type: ignore[operator]
    rng = np.random.default_rng(100 + seed)
    low, high = made.bounds()
    span = (high - low)[:, None]
    points = rng.uniform(low[:, None] - 0.3 * span, high[:, None] + 0.3 * span, (2, 60))
    poses = np.zeros((4, 4))
    poses[:, :2] = rng.uniform(low - 0.3 * span.ravel(), high + 0.3 * span.ravel(), (4, 2))
    for unknown_blocks in (False, True):
        walls = (made.cells == OCCUPIED) | (unknown_blocks & (made.cells == UNKNOWN))
        visible = Sight.of(made, unknown_blocks=unknown_blocks).visible(points, poses)
        for k in range(4):
            np.testing.assert_array_equal(visible[k], seen_by_geometry(made, walls, poses[k], points))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_clear_share_ends_at_the_first_wall_of_a_finely_sampled_ray(seed: int) -> None:
    made = sparse_map(seed)
    rng = np.random.default_rng(seed)
    low, high = made.bounds()
    points = rng.uniform(low[:, None], high[:, None], (2, 100))
    pose = np.append(rng.uniform(low, high), [0.0, 0.0])
    shares = Sight.of(made).clear_shares(points, pose)
    along = np.linspace(0.0, 1.0, 20_001)
    blocked = 0
    for k in range(100):
        samples = pose[:2, None] + along * (points[:, k] - pose[:2])[:, None]
        cells = np.floor(made.to_cells(samples))
        wall = (made.at(samples) == OCCUPIED) & ~(
            (cells == cells[:, :1]).all(axis=0) | (cells == cells[:, -1:]).all(axis=0)
        )
        if wall.any():
            blocked += 1
            assert shares[k] <= along[wall.argmax()] + 1e-12
            # A corner cut by less than a sample's step may stop the ray earlier; that is what exact means.
            assert made.at((pose[:2] + (shares[k] + 1e-9) * (points[:, k] - pose[:2]))[:, None]) == [OCCUPIED]
    assert blocked > 10


@pytest.mark.parametrize("seed", SEEDS)
def test_who_sees_is_seen(seed: int) -> None:
    made = random_map(seed)
    sight = Sight.of(made)
    rng = np.random.default_rng(seed)
    low, high = made.bounds()
    poses = np.zeros((30, 4))
    poses[:, :2] = rng.uniform(low, high, (30, 2))
    visible = sight.visible(np.ascontiguousarray(poses[:, :2].T), poses)
    np.testing.assert_array_equal(visible, visible.T)
    assert visible.diagonal().all()


@pytest.mark.parametrize("seed", SEEDS)
def test_turning_and_moving_the_world_changes_nothing(seed: int) -> None:
    made = sparse_map(seed)
    rng = np.random.default_rng(seed)
    coordinates, eyes = rng.uniform(0, 67, (2, 80)), rng.uniform(0, 41, (2, 5))
    seen = []
    for origin in ([0.0, 0.0, 0.0], [3.0, -7.0, 2.5]):
        moved = OccupancyMap(made.cells, made.resolution, np.array(origin))
        poses = np.zeros((5, 4))
        poses[:, :2] = moved.to_world(eyes).T
        seen.append(Sight.of(moved).visible(moved.to_world(coordinates), poses))
    np.testing.assert_array_equal(*seen)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.05, 0.5, 1.0])
def test_clearance_is_the_distance_in_kings_moves(share: float) -> None:
    walls = np.random.default_rng(3).random((60, 300)) < share
    expected = distance_transform_cdt(~walls, "chessboard") if walls.any() else np.full(walls.shape, 255)
    np.testing.assert_array_equal(chebyshev(walls), np.minimum(expected, 255))


def test_a_robot_in_a_wall_is_not_blind_and_a_target_on_a_wall_is_seen_from_its_front() -> None:
    cells = np.zeros((3, 9), np.uint8)
    cells[:, 4] = OCCUPIED
    sight = Sight.of(OccupancyMap(cells, 1.0, np.zeros(3)))
    points = np.array([[4.5, 8.5, 0.5], [1.5, 1.5, 1.5]])
    eyes = np.array([[0.5, 1.5, 0, 0], [4.5, 1.5, 0, 0], [-3.0, 1.5, 0, 0]])
    np.testing.assert_array_equal(sight.visible(points, eyes), [[1, 0, 1], [1, 1, 1], [1, 0, 1]])


def test_a_map_without_walls_hides_nothing_and_one_of_walls_all_but_neighbours() -> None:
    points = np.random.default_rng(0).uniform(0, 30, (2, 50))
    pose = np.array([15.2, 15.3, 0.0, 0.0])
    assert (
        Sight.of(OccupancyMap(np.zeros((300, 300), np.uint8), 0.1, np.zeros(3))).visible(points, pose).all()
    )
    full = Sight.of(OccupancyMap(np.ones((30, 30), np.uint8), 1.0, np.zeros(3)))
    np.testing.assert_array_equal(
        full.visible(np.array([[15.9, 16.1, 17.1], [15.1, 15.3, 15.3]]), pose), [[True, True, False]]
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_points_that_are_nowhere_are_refused(bad: float) -> None:
    sight = Sight.of(OccupancyMap(np.zeros((3, 3), np.uint8), 1.0, np.zeros(3)))
    with pytest.raises(ValueError, match="points"):
        sight.visible(np.array([[bad], [1.0]]), np.zeros(4))
    with pytest.raises(ValueError, match="points"):
        sight.clear_shares(np.array([[bad], [1.0]]), np.zeros(4))
    with pytest.raises(ValueError, match="pose"):
        sight.visible(np.ones((2, 1)), np.array([bad, 0, 0, 0]))


def test_points_unimaginably_far_away_are_looked_at_all_the_same() -> None:
    cells = np.zeros((3, 9), np.uint8)
    cells[:, 4] = OCCUPIED
    sight = Sight.of(OccupancyMap(cells, 1.0, np.zeros(3)))
    points = np.array([[1e200, -1e200], [1.5, 1.5]])
    np.testing.assert_array_equal(sight.visible(points, np.array([0.5, 1.5, 0, 0])), [[False, True]])
