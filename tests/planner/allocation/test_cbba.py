import dataclasses

import numpy as np
import pytest

from planner.allocation.cbba import (
    AllocationState,
    Bid,
    agreed,
    build_bundle,
    hear,
    lose,
    release,
    word,
)
from tests.planner.allocation.teams import (
    graph,
    greedy,
    in_rounds,
    machines,
    names,
    over_a_bad_network,
    scores,
)


def allocation(states):
    return {state.robot: state.path for state in states}


def expected(team_scores, capacity):
    paths, _, bids = greedy(team_scores, capacity)
    tasks = names(team_scores.tasks, "t")
    by_robot = dict(
        zip(names(team_scores.robots, "r"), (tuple(tasks[j] for j in p) for p in paths), strict=True)
    )
    return by_robot, {tasks[j]: bid for j, bid in bids.items()}


@pytest.mark.parametrize("kind", ["complete", "ring", "line", "random"])
@pytest.mark.parametrize("seed", range(6))
def test_any_connected_graph_agrees_on_the_greedy_allocation(kind, seed):
    given = scores(seed, 10, 14)
    states, rounds = in_rounds(given, 2, graph(kind, 10, seed))
    paths, bids = expected(given, 2)
    assert allocation(states) == paths
    assert all(state.winning_bids == pytest.approx(bids) for state in states)
    assert all(agreed(state) for state in in_more_rounds(states, graph(kind, 10, seed), given))
    assert rounds <= 200


def in_more_rounds(states, heard, given):
    """Ten rounds more: words about who believes what have gone round, and nothing changes."""
    _, values, tasks = machines(given, 2)
    before = allocation(states)
    for turn in range(10):
        states = [build_bundle(s, tasks, v) for s, v in zip(states, values, strict=True)]
        words = [word(s, 1000.0 + turn) for s in states]
        for i in range(len(states)):
            for k in np.flatnonzero(heard[i]):
                states[i], changed = hear(states[i], words[k])
                assert not changed
    assert allocation(states) == before
    return states


@pytest.mark.parametrize("kind", ["complete", "ring", "line", "random"])
@pytest.mark.parametrize("seed", range(5))
def test_lost_doubled_late_and_overtaken_words_change_nothing_in_the_end(kind, seed):
    given = scores(seed, 6, 9)
    states, _ = over_a_bad_network(given, 2, graph(kind, 6, seed), seed)
    paths, bids = expected(given, 2)
    assert allocation(states) == paths
    assert all(state.winning_bids == pytest.approx(bids) for state in states)
    assert all(agreed(state) for state in states)


def test_a_word_heard_twice_or_too_late_changes_nothing():
    states, values, tasks = machines(scores(1, 2, 5), 3)
    a, b = (build_bundle(s, tasks, v) for s, v in zip(states, values, strict=True))
    early = word(b, 1.0)
    late = word(build_bundle(hear(b, word(a, 1.0))[0], tasks, values[1]), 2.0)
    once, changed = hear(a, late)
    assert changed
    for old in (late, early):
        again, changed = hear(once, old)
        assert again == once
        assert not changed


def test_equal_bids_go_to_the_first_in_the_team_order():
    given = scores(0, 3, 2)
    given = dataclasses.replace(
        given, values=np.full((3, 2), 5.0), first=np.ones((3, 2)), first_e=np.full((3, 2), 0.5)
    )
    states, _ = in_rounds(given, 1, graph("line", 3))
    assert [state.path for state in states] == [("t000",), ("t001",), ()]


def test_the_lost_task_and_all_bid_for_after_it_are_released():
    state = AllocationState.start("b", "ab", 3)
    _, values, tasks = machines(scores(3, 1, 3), 3)
    state = build_bundle(state, tasks, values[0])
    assert len(state.bundle) == 3
    lost = state.bundle[1]
    bid = Bid("a", 1.0, {lost: 99.0}, {lost: "a"}, {"a": 1.0}, {})
    state, changed = hear(state, bid)
    assert changed
    only_first = [state.bundle[0], lost]
    less = build_bundle(state, only_first, values[0])
    assert less.bundle == state.bundle[:1]
    assert less.winning_agents == {state.bundle[0]: "b", lost: "a"}
    again = build_bundle(state, tasks, values[0])
    assert again.bundle == (state.bundle[0], state.bundle[2])
    path = list(again.bundle[:1])
    gains, _ = values[0].gains(path, [state.bundle[2]])
    assert again.winning_bids[state.bundle[2]] == pytest.approx(min(gains[0], state.winning_bids[path[0]]))


class Nothing:
    def gains(self, path, tasks):
        return np.full(len(tasks), -np.inf), np.zeros(len(tasks), dtype=np.int64)


class Growing:
    """Every further task is worth more: no diminishing marginal gain."""

    def gains(self, path, tasks):
        return np.array([len(path) + 1.0 + 0.01 * ord(task[0]) for task in tasks]), np.zeros(
            len(tasks), dtype=int
        )


def test_no_bid_is_above_the_one_before_it_whatever_the_score():
    state = build_bundle(AllocationState.start("a", "a", 4), ["w", "x", "y", "z"], Growing())
    bids = [state.winning_bids[task] for task in state.bundle]
    assert bids == sorted(bids, reverse=True)
    assert len(bids) == 4


@pytest.mark.parametrize("seed", range(4))
def test_a_score_without_diminishing_gains_still_ends_without_conflict(seed):
    rng = np.random.default_rng(seed)

    class Wild:
        def __init__(self):
            self.known = {}

        def gains(self, path, tasks):
            key = frozenset(path)
            made = [self.known.setdefault((key, task), rng.uniform(0.1, 10)) for task in tasks]
            return np.array(made), np.zeros(len(tasks), dtype=int)

    robots, tasks = names(5, "r"), names(8, "t")
    states, values = [AllocationState.start(r, robots, 3) for r in robots], [Wild() for _ in robots]
    heard = graph("ring", 5)
    for turn in range(200):
        states = [build_bundle(s, tasks, v) for s, v in zip(states, values, strict=True)]
        words = [word(s, float(turn)) for s in states]
        for i in range(5):
            for k in np.flatnonzero(heard[i]):
                states[i], _ = hear(states[i], words[k])
    assert all(agreed(state) for state in states)
    held = [task for state in states for task in state.bundle]
    assert len(held) == len(set(held)) == 8


@pytest.mark.parametrize("gain", [np.nan, np.inf, -np.inf, 0.0, -1.0])
def test_a_gain_that_is_no_finite_positive_number_is_not_bid_for(gain):
    class Odd:
        def gains(self, path, tasks):
            return np.array([gain if task == "odd" else 1.0 for task in tasks]), np.zeros(
                len(tasks), dtype=int
            )

    state = build_bundle(AllocationState.start("a", "a", 5), ["odd", "even"], Odd())
    assert state.bundle == ("even",)


def test_tasks_that_are_gone_leave_and_make_room():
    _, values, tasks = machines(scores(3, 1, 5), 3)
    state = build_bundle(AllocationState.start("a", "a", 3), tasks, values[0])
    gone = state.bundle[0]
    left = [task for task in tasks if task != gone]
    after = build_bundle(state, left, values[0])
    assert gone not in after.winning_agents
    assert len(after.bundle) == 3
    assert build_bundle(state, [], values[0]).bundle == ()


def test_a_lost_robots_tasks_are_taken_over_until_it_speaks_again():
    given = scores(5, 3, 6)
    states, turns = in_rounds(given, 2, graph("complete", 3))
    _, values, tasks = machines(given, 2)
    gone = states[0]
    left = [lose(state, "r000") for state in states[1:]]
    for turn in range(10):
        left = [build_bundle(s, tasks, v) for s, v in zip(left, values[1:], strict=True)]
        words = [word(s, turns + 1.0 + turn) for s in left]
        left = [hear(left[0], words[1])[0], hear(left[1], words[0])[0]]
        left = [hear(s, dataclasses.replace(words[0], robot="r00x"))[0] for s in left]
    assert all("r000" not in state.winning_agents.values() and agreed(state) for state in left)
    back, _ = hear(left[0], word(gone, 1e3))
    assert back.lost == frozenset()
    assert "r000" in back.winning_agents.values()


def test_words_of_and_about_robots_that_nobody_knows_are_ignored():
    state = AllocationState.start("a", "ab", 2)
    stranger = Bid("x", 1.0, {"t": 9.0}, {"t": "x"}, {"x": 1.0}, {})
    assert hear(state, stranger) == (state, False)
    gossip = Bid("b", 1.0, {"t": 9.0}, {"t": "x"}, {"b": 1.0, "x": 1.0}, {"x": 3})
    heard, changed = hear(state, gossip)
    assert not changed
    assert heard.winning_agents == {}
    assert set(heard.timestamps) == {"b"}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_word_with_a_number_that_is_not_finite_cannot_be_made(bad):
    with pytest.raises(ValueError, match="winning_bids"):
        Bid("a", 1.0, {"t": bad}, {"t": "a"}, {}, {})
    with pytest.raises(ValueError, match="time"):
        Bid("a", bad, {}, {}, {}, {})
    with pytest.raises(ValueError, match="timestamps"):
        Bid("a", 1.0, {}, {}, {"a": bad}, {})
    with pytest.raises(ValueError, match="winning_bids"):
        Bid("a", 1.0, {"t": 1.0}, {}, {}, {})


def test_release_gives_up_all_own_tasks_and_no_others():
    states, _ = in_rounds(scores(5, 3, 6), 2, graph("complete", 3))
    state = release(states[0])
    assert state.bundle == state.path == ()
    assert set(state.winning_agents.values()) == {"r001", "r002"}


def test_no_task_one_robot_and_no_capacity_are_nothing_special():
    alone = AllocationState.start("a", "a", 3)
    assert agreed(alone)
    assert build_bundle(alone, [], Nothing()) == alone
    none = AllocationState.start("a", "a", 0)
    assert build_bundle(none, ["t"], Growing()) == none
    with pytest.raises(ValueError, match="robot"):
        AllocationState.start("x", "ab", 1)
    with pytest.raises(ValueError, match="capacity"):
        AllocationState.start("a", "ab", -1)
