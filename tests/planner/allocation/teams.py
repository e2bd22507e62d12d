"""Teams, graphs and networks to allocate on, the greedy reference and the optimum by brute force."""

import heapq
import itertools

import numpy as np

from planner.allocation.cbba import AllocationState, build_bundle, hear, word
from planner.allocation.score import RobotScore, TeamScores


def scores(seed, robots, tasks, rate=0.02, **more):
    rng = np.random.default_rng(seed)
    starts, places = rng.uniform(0, 100, (robots, 2)), rng.uniform(0, 100, (tasks, 2))
    return TeamScores.of(
        rng.uniform(1, 10, (robots, tasks)),
        np.linalg.norm(starts[:, None] - places, axis=2),
        np.linalg.norm(places[:, None] - places, axis=2),
        rate=rate,
        **more,
    )


def graph(kind, n, seed=0):
    """(n, n) symmetric, connected."""
    heard = np.zeros((n, n), dtype=bool)
    if kind == "complete":
        heard[:] = True
    for i in range(n - 1):
        other = i
        if kind == "random":
            other = np.random.default_rng([seed, i]).integers(i + 1)
        if kind in ("ring", "line", "random"):
            heard[i + 1, other] = heard[other, i + 1] = True
    if kind == "ring":
        heard[0, n - 1] = heard[n - 1, 0] = True
    if kind == "random":
        extra = np.random.default_rng(seed).random((n, n)) < 0.1
        heard |= extra | extra.T
    np.fill_diagonal(heard, False)
    return heard


def names(n, letter):
    return [f"{letter}{i:03d}" for i in range(n)]


def machines(team_scores, capacity):
    """A state machine and its score for every robot."""
    robots, tasks = names(team_scores.robots, "r"), names(team_scores.tasks, "t")
    states = [AllocationState.start(robot, robots, capacity) for robot in robots]
    return states, [RobotScore(team_scores, i, tasks) for i in range(len(robots))], tasks


def in_rounds(team_scores, capacity, heard, rounds=500):
    """The state machines in step: all build, then each hears its neighbours; and the rounds it took."""
    states, values, tasks = machines(team_scores, capacity)
    for turn in range(rounds):
        built = [build_bundle(s, tasks, v) for s, v in zip(states, values, strict=True)]
        words = [word(s, float(turn)) for s in built]
        after = []
        for i in range(len(built)):
            state = built[i]
            for k in np.flatnonzero(heard[i]):
                state, _ = hear(state, words[k])
            after.append(state)
        same = all(a.winning_agents == after[0].winning_agents for a in built + after)
        if same and all(a.winning_bids == after[0].winning_bids for a in built + after):
            return after, turn
        states = after
    raise AssertionError(f"no agreement after {rounds} rounds")


def over_a_bad_network(team_scores, capacity, heard, seed, seconds=400.0, loss=0.3, again=0.2, delay=5.0):
    """State machines at their own beats, clocks far apart; words are lost, doubled, overtaken and late."""
    rng = np.random.default_rng(seed)
    states, values, tasks = machines(team_scores, capacity)
    offsets = rng.uniform(-1e4, 1e4, len(states))
    order = itertools.count()
    events = [(rng.uniform(0, 1), next(order), i, None) for i in range(len(states))]
    heapq.heapify(events)
    last_change = 0.0
    while events:
        now, _, i, message = heapq.heappop(events)
        if message is not None:
            before = states[i]
            states[i], changed = hear(before, message)
            kept = states[i].winning_bids == before.winning_bids
            assert changed == (not (kept and states[i].winning_agents == before.winning_agents))
            continue
        if now > seconds:
            continue
        built = build_bundle(states[i], tasks, values[i])
        if (built.winning_agents, built.bundle) != (states[i].winning_agents, states[i].bundle):
            last_change = now
        states[i] = built
        said = word(built, now + offsets[i])
        for k in np.flatnonzero(heard[i]):
            for _ in range(1 + (rng.random() < again)):
                if rng.random() > loss:
                    heapq.heappush(events, (now + rng.exponential(delay), next(order), k, said))
        heapq.heappush(events, (now + rng.uniform(0.5, 1.5), next(order), i, None))
    return states, last_change


def greedy(team_scores, capacity):
    """The sequential greedy allocation: the best pair of robot and task, one after the other, bids warped."""
    n, t = team_scores.robots, team_scores.tasks
    paths, ceilings = [[] for _ in range(n)], [np.inf] * n
    bids, winner = {}, {}
    while True:
        best = None
        for i in range(n):
            if len(paths[i]) == capacity:
                continue
            gains, places = team_scores.gains(i, np.array(paths[i], dtype=np.int64))
            left = [j for j in range(t) if j not in winner and 0 < gains[j] < np.inf]
            if left:
                j = max(left, key=lambda j: gains[j])
                bid = min(gains[j], ceilings[i])
                if best is None or bid > best[0]:
                    best = (bid, i, j, places[j])
        if best is None:
            return paths, winner, bids
        bid, i, j, place = best
        paths[i].insert(place, j)
        winner[j], bids[j], ceilings[i] = i, bid, bid


def worth(team_scores, robot, path, rate):
    """S(p), written out."""
    total, clock, before = 0.0, 0.0, None
    for task in path:
        leg = team_scores.first[robot, task] if before is None else team_scores.legs[0, before, task]
        clock += leg
        total += team_scores.values[robot, task] * np.exp(-rate * clock) - team_scores.fuel * leg
        clock += team_scores.durations[task]
        before = task
    return total


def optimum(team_scores, capacity, rate):
    """The best worth of any allocation, by trying all orders of all subsets, then all partitions."""
    n, t = team_scores.robots, team_scores.tasks
    best = np.zeros(1 << t)
    for i in range(n):
        own = np.full(1 << t, -np.inf)
        for size in range(min(capacity, t) + 1):
            for path in itertools.permutations(range(t), size):
                mask = sum(1 << j for j in path)
                own[mask] = max(own[mask], worth(team_scores, i, path, rate))
        both = np.full(1 << t, -np.inf)
        for mask in range(1 << t):
            part = mask
            while True:
                both[mask] = max(both[mask], best[mask ^ part] + own[part])
                if not part:
                    break
                part = (part - 1) & mask
        best = both
    return best.max()
