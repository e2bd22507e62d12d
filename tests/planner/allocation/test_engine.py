import numpy as np
import pytest

from planner.allocation.auction import HEARING, ROBOT, ROUND
from planner.allocation.engine import allocate, connected, named
from planner.allocation.rounds import run
from planner.allocation.score import TeamScores
from planner.allocation.slots import incomplete, slots, task_of, without_task
from tests.planner.allocation.teams import graph, greedy, in_rounds, names, optimum, scores, worth

RATE = 0.02


@pytest.mark.parametrize("kind", ["complete", "ring", "line", "random"])
@pytest.mark.parametrize("seed", range(4))
def test_arrays_come_to_the_very_same_as_the_state_machines(kind, seed):
    extra = {"fuel": 0.01, "durations": np.full(12, 3.0), "limits": np.full(7, 150.0)} if seed % 2 else {}
    given = scores(seed, 7, 12, **extra)
    heard = graph(kind, 7, seed)
    fast = allocate(given, 3, neighbours=heard)
    states, rounds = in_rounds(given, 3, heard)
    tasks, robots = names(12, "t"), names(7, "r")
    assert fast.converged
    assert fast.rounds == rounds
    for i, state in enumerate(states):
        assert tuple(tasks[j] for j in fast.paths[i]) == state.path
        assert tuple(tasks[j] for j in fast.bundles[i]) == state.bundle
        y = {tasks[j]: fast.winning_bids[i, j] for j in range(12) if fast.winning_agents[i, j] >= 0}
        z = {tasks[j]: robots[k] for j, k in enumerate(fast.winning_agents[i]) if k >= 0}
        assert (y, z) == (dict(state.winning_bids), dict(state.winning_agents))


@pytest.mark.parametrize("seed", range(40))
def test_any_connected_graph_of_any_size_gives_the_greedy_allocation(seed):
    rng = np.random.default_rng(seed)
    n, t, capacity = int(rng.integers(1, 30)), int(rng.integers(1, 40)), int(rng.integers(1, 8))
    kind = ["complete", "ring", "line", "random"][seed % 4]
    heard = graph(kind, n, seed)
    given = scores(seed, n, t)
    assert connected(heard)
    made = allocate(given, capacity, neighbours=heard)
    paths, winner, _ = greedy(given, capacity)
    assert made.converged
    assert [path.tolist() for path in made.paths] == paths
    held = np.concatenate(made.paths)
    assert len(held) == len(set(held)) == len(winner)
    assert (made.winning_agents == made.winning_agents[0]).all()


@pytest.mark.parametrize("kind", ["ring", "line"])
def test_ten_robots_on_a_ring_never_do_a_task_twice(kind):
    for seed in range(60):
        made = allocate(scores(seed, 10, 25), 5, neighbours=graph(kind, 10))
        held = np.concatenate(made.paths)
        assert made.converged
        assert len(held) == len(set(held))


@pytest.mark.parametrize("kind", ["complete", "ring", "line", "random"])
def test_at_least_half_of_the_optimum_always_and_93_percent_on_average(kind):
    shares = []
    for seed in range(40):
        n, t, capacity = [(2, 5, 3), (3, 5, 2), (4, 6, 2), (3, 6, 2)][seed % 4]
        given = scores(seed, n, t, RATE)
        made = allocate(given, capacity, neighbours=graph(kind, n, seed))
        reached = sum(worth(given, i, path, RATE) for i, path in enumerate(made.paths))
        shares.append(reached / optimum(given, capacity, RATE))
    assert min(shares) >= 0.5
    assert max(shares) <= 1 + 1e-9
    assert np.mean(shares) >= 0.93


@pytest.mark.parametrize("seed", range(5))
def test_gains_are_those_of_all_insertions_tried_one_by_one(seed):
    given = scores(seed, 2, 7, RATE, fuel=0.03, durations=np.linspace(0, 9, 7))
    path = np.random.default_rng(seed).permutation(7)[:4]
    gains, places = given.gains(1, path)
    for j in set(range(7)) - set(path):
        tried = [
            worth(given, 1, [*path[:at], j, *path[at:]], RATE) - worth(given, 1, path, RATE)
            for at in range(5)
        ]
        assert gains[j] == pytest.approx(max(tried))
        assert places[j] == int(np.argmax(tried))


def test_no_path_takes_longer_than_its_limit_with_the_way_home():
    rng = np.random.default_rng(2)
    home = rng.uniform(0, 50, (4, 20))
    limits = np.array([30.0, 60.0, 120.0, 0.0])
    given = scores(2, 4, 20, limits=limits, home=home, durations=np.full(20, 2.0))
    made = allocate(given, 10)
    for i, path in enumerate(made.paths):
        legs = [given.first[i, path[0]], *given.legs[0, path[:-1], path[1:]]] if len(path) else []
        assert sum(legs) + 2.0 * len(path) + (home[i, path[-1]] if len(path) else 0) <= limits[i] + 1e-9
    assert len(made.paths[2]) > 1
    assert len(made.paths[3]) == 0


def test_a_way_that_does_not_exist_is_never_taken_and_poisons_no_number():
    given = scores(0, 2, 4)
    legs = given.legs[0].copy()
    legs[0, 1:] = legs[1:, 0] = np.inf  # task 0 is an island
    first = given.first.copy()
    first[0, 0] = np.inf
    values = np.where(np.isfinite(given.values), given.values, 0)
    for rate in (0.0, 0.02):
        made = allocate(TeamScores.of(values, first, legs, rate=rate), 4)
        assert made.converged
        assert 0 not in made.paths[0]
        assert np.isfinite(made.winning_bids).all()
        if 0 in made.paths[1] and rate > 0:
            assert len(made.paths[1]) == 1


def test_tasks_that_need_several_robots_get_them_or_nobody():
    given = scores(4, 4, 4)
    columns = np.array([0, 0, 1, 1, 1, 1, 1, 2, 3, 3])  # task 1 needs five of four robots
    needed = np.bincount(columns)[columns]
    slotted = TeamScores.of(
        given.values[:, columns], given.first[:, columns], given.legs[0][np.ix_(columns, columns)], rate=RATE
    )
    made = allocate(slotted, 3, neighbours=graph("ring", 4), groups=columns, needed=needed)
    counts = {0: 0, 1: 0, 2: 0, 3: 0}
    for path in made.paths:
        tasks = columns[path]
        assert len(tasks) == len(set(tasks))  # never two slots of one task
        for task in tasks:
            counts[task] += 1
    assert counts == {0: 2, 1: 0, 2: 1, 3: 2}


def test_slots_have_names_of_their_own():
    assert slots("a", 1) == ("a",)
    assert slots("a", 2) == ("a#1", "a#2")
    assert [task_of(slot) for slot in ("a", "a#2")] == ["a", "a"]
    agents = {"a#1": "r", "b#1": "r", "c": "s", "d#1": "r", "d#2": "s"}
    bids = {"a#1": 2.0, "b#1": 1.0, "c": 0.1, "d#1": 0.1, "d#2": 0.1}
    assert incomplete({"a": 2, "b": 2, "c": 1, "d": 2}, agents, bids) == "b"
    assert incomplete({"d": 2}, {"d#1": "r", "d#2": "s"}, bids) is None
    assert without_task(["a#1", "b", "a#2"], "a") == ["b"]
    with pytest.raises(ValueError, match="robots"):
        slots("a", 0)
    with pytest.raises(ValueError, match="task"):
        slots("a#1", 2)


@pytest.mark.parametrize(("n", "t", "capacity"), [(0, 3, 2), (3, 0, 2), (1, 1, 1), (3, 3, 0), (1, 5, 9)])
def test_no_robots_no_tasks_and_no_capacity_are_nothing_special(n, t, capacity):
    made = allocate(scores(0, n, t), capacity)
    assert made.converged
    assert sum(len(path) for path in made.paths) == (min(t, n * capacity) if n else 0)
    assert made.worth >= 0


def test_two_hundred_robots_agree():
    made = allocate(scores(1, 200, 100), 3, neighbours=graph("random", 200))
    assert made.converged
    assert len(np.concatenate(made.paths)) == 100


def test_what_cannot_be_scored_is_refused_by_name():
    good = {"values": np.ones((2, 3)), "first": np.ones((2, 3)), "legs": np.ones((3, 3))}
    for name, bad in [
        ("values", np.full((2, 3), np.nan)),
        ("values", np.full((2, 3), np.inf)),
        ("values", np.ones(3)),
        ("first", np.full((2, 3), -1.0)),
        ("first", np.ones((2, 2))),
        ("legs", np.full((3, 3), np.nan)),
        ("kinds", np.array([0, 1])),
        ("durations", np.ones(2)),
        ("limits", np.array([1.0, np.nan])),
        ("home", np.ones((2, 2))),
        ("rate", -1.0),
        ("fuel", np.nan),
    ]:
        with pytest.raises(ValueError, match=f"^{name}: "):
            TeamScores.of(**{**good, name: bad})
    nobody_can = TeamScores.of(np.full((2, 3), -np.inf), good["first"], good["legs"])
    assert all(len(path) == 0 for path in allocate(nobody_can, 3).paths)
    with pytest.raises(ValueError, match="neighbours"):
        allocate(nobody_can, 1, neighbours=np.ones((3, 3), dtype=bool))
    with pytest.raises(ValueError, match="groups"):
        allocate(nobody_can, 1, groups=np.zeros(2, dtype=int))
    with pytest.raises(ValueError, match="needed"):
        allocate(nobody_can, 1, needed=np.zeros(2, dtype=int))
    with pytest.raises(ValueError, match="capacity"):
        allocate(nobody_can, -1)


def test_paths_have_names_for_people():
    assert named([np.array([1, 0]), np.array([], dtype=int)], ["a", "b"], ["s", "t"]) == {
        "a": ("t", "s"),
        "b": (),
    }


@pytest.mark.parametrize("kind", ["complete", "ring", "line"])
@pytest.mark.parametrize("seed", range(3))
def test_parts_make_no_difference(kind, seed, monkeypatch):
    monkeypatch.setattr("planner.allocation.engine.PART", 1)  # the clock is looked at after every robot
    given, heard = scores(seed, 9, 20), graph(kind, 9, seed)
    asked = []
    parts = allocate(given, 4, neighbours=heard, over=lambda: bool(asked.append(1)))
    whole = allocate(given, 4, neighbours=heard)
    assert len(asked) > 2 * 9
    assert parts.rounds == whole.rounds
    assert [path.tolist() for path in parts.paths] == [path.tolist() for path in whole.paths]
    np.testing.assert_array_equal(parts.winning_bids, whole.winning_bids)


@pytest.mark.parametrize("parts", range(0, 40, 3))
def test_an_allocation_that_is_interrupted_says_what_each_robot_believes_by_then(parts, monkeypatch):
    monkeypatch.setattr("planner.allocation.engine.PART", 1)
    left = [parts]

    def over():
        left[0] -= 1
        return left[0] < 0

    given = scores(1, 9, 20)
    made = allocate(given, 4, neighbours=graph("ring", 9), over=over)
    assert not made.converged
    for i, (path, bundle) in enumerate(zip(made.paths, made.bundles, strict=True)):
        assert sorted(path) == sorted(bundle)
        assert len(set(path.tolist())) == len(path) <= 4
        for level in range(len(path)):  # each was worth its bid when it was bid for
            gains, _ = given.gains(i, path[[task in bundle[:level] for task in path]])
            assert gains[bundle[level]] > 0
    assert (parts == 0) == all(len(path) == 0 for path in made.paths)


def test_hundreds_of_robots_are_interrupted_between_robots(monkeypatch):
    n, t = 300, 400
    work = []

    def counted(prices, auction, max_rounds, most):
        before = auction.marks.copy()
        said = run(prices, auction, max_rounds, most)
        work.append((before, auction.marks.copy()))
        return said

    monkeypatch.setattr("planner.allocation.engine.run", counted)
    allocate(scores(0, n, t), 5, over=lambda: len(work) >= 50)
    # A robot that hears 299 others speak of 400 tasks looks at 120,000 words: not many robots fit in a part.
    assert len(work) == 50
    assert all(
        after[ROBOT] - before[ROBOT] <= n // 4
        for before, after in work
        if before[HEARING] and after[HEARING] and before[ROUND] == after[ROUND]
    )
