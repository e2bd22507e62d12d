"""Sampled paths are walkable, and their rewards are those of the definition, (9), (15), worked out slowly."""

import itertools

import numpy as np
import pytest

from planner.sampling.board import MOVES, board, turn_table
from planner.sampling.search import Breeding, greedy, search


def slow_reward(values, detection, cells):
    """(15c)-(15e) with a copy of the whole unobserved intensity for every look."""
    left, total = np.array(values, dtype=float).ravel(), 0.0
    for cell in cells:
        p = np.zeros(left.size)
        p[cell] = np.broadcast_to(detection, left.shape)[cell]
        total += float((left * p).sum())
        left = left * (1 - p)
    return total


def slow_footprint_reward(values, rows, cells, headings=None):
    left, total = np.array(values, dtype=float).ravel(), 0.0
    for k, cell in enumerate(cells):
        row = cell + (0 if headings is None else headings[k] * left.size)
        total += float((left * rows[row]).sum())
        left = left * (1 - rows[row])
    return total


def sparse(rows):
    offsets = np.concatenate([[0], np.cumsum((rows > 0).sum(axis=1))]).astype(np.int64)
    return offsets, np.nonzero(rows)[1].astype(np.int64), rows[rows > 0]


def steps_of(shape, cells):
    return np.diff(np.stack(np.unravel_index(cells, shape)), axis=1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("shape", [(7, 9), (1, 12), (4, 5, 3)])
def test_a_reward_counts_each_target_once_however_often_its_cell_is_observed(seed, shape):
    rng = np.random.default_rng(seed)
    values, p = rng.exponential(size=shape), rng.uniform(0, 1, int(np.prod(shape)))
    start = int(rng.integers(p.size))
    for path in search(board(shape, values, p), start, 50, 300, seed)[0]:
        assert path.cells[0] == start
        assert path.cells.size == 51
        moves = steps_of(shape, path.cells)
        assert np.abs(moves).max() == 1  # neighbours, and never standing still
        assert (np.abs(moves).max(axis=0) == 1).all()
        assert path.reward == pytest.approx(slow_reward(values, p, path.cells), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_wide_footprint_is_accounted_for_cell_by_cell(seed):
    rng = np.random.default_rng(seed)
    n, shape = 30, (5, 6)
    values = rng.exponential(size=n)
    rows = np.where(rng.random((n, n)) < 0.3, rng.uniform(0, 1, (n, n)), 0.0)
    for path in search(board(shape, values, footprints=sparse(rows)), 3, 40, 100, seed)[0]:
        assert path.reward == pytest.approx(slow_footprint_reward(values, rows, path.cells), abs=1e-9)


def test_a_footprint_follows_the_heading():
    rng = np.random.default_rng(4)
    n, shape = 20, (5, 4)
    values, rows = rng.exponential(size=n), rng.uniform(0, 0.5, (8 * n, n))
    path = search(board(shape, values, footprints=sparse(rows), headings=8), 7, 25, 50, 1)[0][0]
    moves = steps_of(shape, path.cells)
    yaw = np.round(np.arctan2(moves[1], moves[0]) / (np.pi / 4)).astype(int) % 8
    first = round(np.arctan2(-1, -1) / (np.pi / 4)) % 8  # without a heading, as after the first move
    headings = np.concatenate([[first], yaw])
    assert path.reward == pytest.approx(slow_footprint_reward(values, rows, path.cells, headings), abs=1e-9)


def king_paths(shape, start, steps):
    """All paths of so many steps to neighbours."""
    paths = [[start]]
    for _ in range(steps):
        longer = []
        for path in paths:
            x, y = divmod(path[-1], shape[1])
            for dx, dy in itertools.product((-1, 0, 1), repeat=2):
                if (dx or dy) and 0 <= x + dx < shape[0] and 0 <= y + dy < shape[1]:
                    longer.append([*path, (x + dx) * shape[1] + y + dy])
        paths = longer
    return paths


@pytest.mark.parametrize("seed", range(4))
def test_many_samples_find_the_best_of_all_paths_on_a_tiny_grid(seed):
    rng = np.random.default_rng(seed)
    shape, values = (3, 3), rng.exponential(size=9)
    best = max(slow_reward(values, 0.7, path) for path in king_paths(shape, 4, 5))
    found = search(board(shape, values, 0.7), 4, 5, 30_000, seed)[0][0]
    assert found.reward <= best + 1e-12
    assert found.reward == pytest.approx(best, rel=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_the_first_points_are_drawn_in_proportion_to_what_is_unobserved(seed):
    values = np.array([0.0, 1.0, 2.0, 0.0, 4.0, 3.0])
    b = board((2, 3), values, 0.0)
    count = np.zeros(6)
    from planner.sampling.batch import sample_paths

    nobody = np.empty((0, 1), dtype=np.int64), np.empty(0, dtype=np.int64)
    cells, genes = np.empty(2, dtype=np.int64), np.empty(10, dtype=np.int64)
    for i in range(8000):
        sample_paths(b, 0, seed, i, 1, *nobody, 0.0, cells, genes)
        count[genes[0] >> 1] += 1
    np.testing.assert_allclose(count / 8000, values / 10, atol=0.02)


def test_what_is_observed_on_the_way_is_not_headed_for_again():
    """With certain detection a path over a handful of cells with targets observes them all, and once."""
    values = np.zeros((12, 12))
    values[[1, 10, 3, 8], [9, 2, 3, 11]] = 1.0
    path = search(board((12, 12), values, 1.0), 0, 60, 200, 2)[0][0]
    assert path.reward == pytest.approx(4.0)


@pytest.mark.parametrize("seed", range(3))
def test_turns_stay_within_the_limit(seed):
    rng = np.random.default_rng(seed)
    values = rng.exponential(size=(10, 10))
    b = board((10, 10), values, 0.9, turns=turn_table(45.0), heading=0)
    found = search(b, 55, 40, 60, seed)[0]
    for path in found[:10]:
        moves = steps_of((10, 10), path.cells)
        moves = np.hstack([MOVES[0, :2, None], moves])
        yaw = np.arctan2(moves[1], moves[0])
        turns = np.abs((np.diff(yaw) + np.pi) % (2 * np.pi) - np.pi)
        assert (np.degrees(turns) <= 45 + 1e-6).all()
        assert path.reward == pytest.approx(slow_reward(values, 0.9, path.cells), abs=1e-9)
    assert found[0].cells.size == 41


def test_the_result_is_the_same_by_any_number_of_threads():
    b = board((30, 30), np.random.default_rng(0).exponential(size=900), 0.8)
    one, two, five = (search(b, 0, 200, 1000, 7, threads=t) for t in (1, 2, 5))
    for other in (two, five):
        assert other[1] == one[1] == 1000
        for path, same in zip(one[0], other[0], strict=True):
            assert path.reward == same.reward
            assert (path.cells == same.cells).all()


@pytest.mark.parametrize("seed", range(3))
def test_more_samples_and_generations_never_find_less(seed):
    b = board((20, 20), np.random.default_rng(seed).exponential(size=400) ** 3, 0.9)
    few, many = (search(b, 0, 80, n, seed)[0][0].reward for n in (500, 4000))
    bred = search(b, 0, 80, 500, seed, breeding=Breeding(generations=3, children=500))[0]
    assert many >= few
    assert bred[0].reward > few
    for path in bred:
        assert path.reward == pytest.approx(slow_reward(b.values, 0.9, path.cells), abs=1e-9)


def test_a_search_ends_when_the_time_is_over():
    b = board((20, 20), np.ones(400))
    asked = iter([False, False, True])
    found, sampled = search(b, 0, 500, 10**9, 0, over=lambda: next(asked))
    assert found
    assert 0 < sampled < 10**4
    assert search(b, 0, 50, 10, 0, over=lambda: True) == ([], 0)


@pytest.mark.parametrize("seed", range(3))
def test_greedy_heads_for_the_most_unobserved_until_it_is_there(seed):
    rng = np.random.default_rng(seed)
    values = rng.exponential(size=(8, 8))
    path = greedy(board((8, 8), values, 0.9), 0, 30)
    assert path.cells.size == 31
    assert path.reward == pytest.approx(slow_reward(values, 0.9, path.cells), abs=1e-9)
    left, at = values.ravel().copy(), 0
    left[0] *= 0.1
    for gene in path.genes:
        others = left.copy()
        others[path.cells[at]] = -1.0
        assert gene >> 1 == int(np.argmax(others))
        while at < 30 and path.cells[at] != gene >> 1:
            at += 1
            left[path.cells[at]] *= 0.1


@pytest.mark.parametrize(
    ("word", "make"),
    [
        ("shape", lambda: board((0, 3), np.zeros(0))),
        ("values", lambda: board((2, 3), np.zeros(5))),
        ("detection", lambda: board((2, 3), np.zeros(6), 1.5)),
        ("detection", lambda: board((2, 3), np.zeros(6), np.nan)),
        ("start", lambda: search(board((2, 3), np.ones(6)), 6, 5, 1, 0)),
        ("steps", lambda: search(board((2, 3), np.ones(6)), 0, 0, 1, 0)),
    ],
)
def test_bad_input_names_the_argument(word, make):
    with pytest.raises(ValueError, match=word):
        make()


def test_values_that_are_no_numbers_count_as_nothing():
    b = board((2, 2), np.array([np.nan, np.inf, -1.0, 2.0]))
    assert b.values.tolist() == [0.0, 0.0, 0.0, 2.0]
    assert search(b, 0, 4, 20, 0)[0][0].reward == pytest.approx(2.0)
    assert search(board((2, 2), np.zeros(4)), 0, 4, 20, 0)[0][0].reward == 0.0
