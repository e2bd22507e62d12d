import math

import numpy as np
import pytest

from planner.vehicles.dubins import WORDS, path, shortest, to_point


def random_pair(seed, spread):
    rng = np.random.default_rng(seed)
    return np.append(rng.uniform(-spread, spread, 2), rng.uniform(-4, 4)), np.append(
        rng.uniform(-spread, spread, 2), rng.uniform(-4, 4)
    )


def brute_force(start, goal, radius):
    """The least length over all words, by trying all lengths of the first part on a fine grid.

    Knows nothing of circles' tangents: after the first arc it solves straight-then-arc or arc-then-arc by
    search over the second part, and accepts what ends within a tolerance of the goal.
    """
    best = math.inf
    turn = 2 * math.pi * radius
    senses = {"L": 1, "R": -1, "S": 0}
    firsts = np.linspace(0, turn, 361)[:-1]
    for word in WORDS:
        a, b, c = (senses[letter] / radius for letter in word)
        seconds = np.linspace(0, turn if b else 8 * radius, 361)[:-1]
        f, s = np.meshgrid(firsts, seconds, indexing="ij")

        def move(x, y, yaw, curvature, length):
            if curvature == 0:
                return x + length * np.cos(yaw), y + length * np.sin(yaw), yaw
            end = yaw + curvature * length
            return (
                x + (np.sin(end) - np.sin(yaw)) / curvature,
                y - (np.cos(end) - np.cos(yaw)) / curvature,
                end,
            )

        x, y, yaw = move(*move(start[0], start[1], start[2], a, f), b, s)
        third = np.mod(math.copysign(1, c) * (goal[2] - yaw), 2 * math.pi) * radius
        ex, ey, _ = move(x, y, yaw, c, third)
        close = np.hypot(ex - goal[0], ey - goal[1]) < 0.03 * radius
        if close.any():
            best = min(best, float((f + s + third)[close].min()))
    return best


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("spread", [1.0, 3.0, 10.0])
def test_every_word_ends_at_the_goal(seed, spread):
    start, goal = random_pair(seed, spread)
    for word in WORDS:
        way = path(word, start, goal, 1.3)
        if way is not None:
            end = way.pose(start, way.length)
            np.testing.assert_allclose(end[:2], goal[:2], atol=1e-9)
            assert math.remainder(end[2] - goal[2], 2 * math.pi) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_shortest_is_that_of_a_search_over_all_parts(seed):
    start, goal = random_pair(100 + seed, 1.5)
    found = brute_force(start, goal, 1.0)
    assert shortest(start, goal, 1.0).length == pytest.approx(found, abs=0.1)


def test_known_lengths():
    start = np.zeros(3)
    assert shortest(start, np.array([5.0, 0.0, 0.0]), 1.0).length == pytest.approx(5.0)
    assert shortest(start, np.array([0.0, 2.0, math.pi]), 1.0).length == pytest.approx(math.pi)
    assert shortest(start, start, 1.0).length == pytest.approx(0.0)
    # A turn on the spot takes RLR or LRL: 7 π / 3, the textbook's worst case.
    assert shortest(start, np.array([0.0, 0.0, math.pi]), 1.0).length == pytest.approx(7 * math.pi / 3)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("spread", [1.0, 4.0])
def test_the_way_to_a_point_is_the_best_over_all_headings_there(seed, spread):
    start, goal = random_pair(seed, spread)
    way = to_point(*start, goal[0], goal[1], 1.0)
    headings = np.linspace(0, 2 * math.pi, 361)
    lengths = [
        shortest(start, np.array([goal[0], goal[1], heading]), 1.0).length for heading in headings[::8]
    ]
    assert way[1] + way[3] <= min(lengths) + 1e-9
    assert way[1] + way[3] == pytest.approx(min(lengths), abs=0.02)


@pytest.mark.parametrize(
    ("goal", "radius", "name"),
    [([0, 0, math.nan], 1.0, "goal"), ([1, 0, 0], 0.0, "radius"), ([1, 0, 0], math.inf, "radius")],
)
def test_nonsense_is_refused_by_name(goal, radius, name):
    with pytest.raises(ValueError, match=name):
        shortest(np.zeros(3), np.array(goal, dtype=float), radius)
