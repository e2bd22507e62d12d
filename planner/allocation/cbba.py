"""The Consensus-Based Bundle Algorithm of one robot, as a frozen state and pure functions.

Sources: Choi, Brunet, How (2009): bundle construction (algorithm 3), consensus (table 1, see `consensus`),
release of the bundle's tail (6). Ponda et al. (2012), section III.B.1: allocation in a search team.
Johnson, Choi, Ponda, How, "Allowing non-submodular score functions in distributed task allocation", CDC 2012:
no bid above the one before it in the bundle, which gives the diminishing marginal gain that convergence
rests on, whatever the score.

One robot's round: `hear` every message that has come, `build_bundle`, send `word(state, now)` to the
neighbours. Rounds of different robots need no common beat, as in the asynchronous CBBA (Johnson, Ponda, Choi,
How, "Improving the efficiency of a decentralized tasking algorithm for UAV teams with asynchronous
communications", 2010), for three reasons. A timestamp s[m] is the time on robot m's own clock at which it
said what is known of it, and not the time of reception, so that timestamps compare whatever way a word took
and however clocks differ. A message is a robot's whole view, so that one that is older than what is known of
its sender has nothing to add, and is dropped: duplicates and overtaken messages do no harm. And the word is
sent again and again, so that lost ones are made up for. Robots agree on what a centre gets that takes
the best remaining pair of robot and task one after another, whatever the graph and the network.
"""

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planner.allocation.consensus import LEAVE, NOBODY, UPDATE, beats, verdict
from planner.allocation.score import Score
from planner.allocation.slots import task_of


@dataclass(frozen=True, slots=True)
class AllocationState:
    """What one robot holds; tasks without a winner are in neither `winning_bids` nor `winning_agents`."""

    robot: str
    team: tuple[str, ...]  # all robots that may bid, in the order that tells equal bids apart
    capacity: int  # tasks in a bundle, at most
    bundle: tuple[str, ...] = ()  # b: own tasks in the order of their bids
    path: tuple[str, ...] = ()  # p: own tasks in the order of execution
    winning_bids: Mapping[str, float] = field(default_factory=dict)  # y, by task
    winning_agents: Mapping[str, str] = field(default_factory=dict)  # z, by task
    timestamps: Mapping[str, float] = field(default_factory=dict)  # s, by robot, on that robot's clock
    digests: Mapping[str, int] = field(default_factory=dict)  # of what each robot last believed
    lost: frozenset[str] = frozenset()  # robots that are gone until they are heard again

    @staticmethod
    def start(robot: str, team: Iterable[str], capacity: int) -> "AllocationState":
        """Nothing known, nothing bid.

        Raises:
            ValueError: if the robot is not in the team or the capacity is negative.
        """
        members = tuple(sorted(set(team)))
        if robot not in members:
            raise ValueError(f"robot: expected one of the team {', '.join(members)}, got {robot!r}")
        if capacity < 0:
            raise ValueError(f"capacity: expected a number >= 0, got {capacity}")
        return AllocationState(robot, members, capacity)


@dataclass(frozen=True, slots=True)
class Bid:
    """One robot's word to its neighbours: y, z and s, and what it knows the others believe."""

    robot: str
    time: float  # on the sender's clock
    winning_bids: Mapping[str, float]
    winning_agents: Mapping[str, str]
    timestamps: Mapping[str, float]
    digests: Mapping[str, int]
    tasks: frozenset[str] | None = None  # that the sender knows of (slots' tasks); None: all that there are

    def __post_init__(self) -> None:
        if not np.isfinite(self.time):
            raise ValueError(f"time: expected a finite number, got {self.time}")
        if self.winning_bids.keys() != self.winning_agents.keys():
            raise ValueError("winning_bids: expected the tasks of winning_agents")
        for name, numbers in (("winning_bids", self.winning_bids), ("timestamps", self.timestamps)):
            if not np.isfinite(np.fromiter(numbers.values(), dtype=np.float64)).all():
                raise ValueError(f"{name}: every number must be finite")


def build_bundle(state: AllocationState, tasks: Sequence[str], score: Score) -> AllocationState:
    """Bid anew, task after task, for what is worth most and can be won from the others: phase 1.

    Where nothing changed the same bundle comes out. Where a task was lost, so is all that was bid for after
    it (6), and bid for again at its worth without it. Where one became free that would have been chosen
    earlier, it is: the published algorithm leaves it to the bundle's end, where it is worth less.

    Args:
        state: of the robot.
        tasks: all that there are now; bids for others are forgotten. Of the slots of one task (see `slots`) a
            robot takes at most one.
        score: what paths are worth; a gain that is no finite positive number is not bid for.
    """
    known = frozenset(tasks)
    agents = {task: z for task, z in state.winning_agents.items() if z != state.robot and task in known}
    bids = {task: state.winning_bids[task] for task in agents}
    rank = {robot: number for number, robot in enumerate(state.team)}
    own, ceiling = rank[state.robot], np.inf
    bundle: list[str] = []
    path: list[str] = []
    left = list(tasks)
    while left and len(bundle) < state.capacity:
        gains, places = score.gains(path, left)
        best, best_gain = -1, 0.0
        for j, task in enumerate(left):
            gain = float(gains[j])
            if not best_gain < gain < np.inf:
                continue
            holder = rank[agents[task]] if task in agents else NOBODY
            if beats(min(gain, ceiling), own, bids.get(task, 0.0), holder):
                best, best_gain = j, gain
        if best < 0:
            break
        task, ceiling = left[best], min(best_gain, ceiling)
        bundle.append(task)
        path.insert(int(places[best]), task)
        bids[task], agents[task] = ceiling, state.robot
        left = [other for other in left if task_of(other) != task_of(task)]
    return replace(state, bundle=tuple(bundle), path=tuple(path), winning_bids=bids, winning_agents=agents)


def word(state: AllocationState, now: float) -> Bid:
    """What to tell the neighbours at time `now` of the robot's own clock, which must never go back."""
    return Bid(
        robot=state.robot,
        time=now,
        winning_bids=state.winning_bids,
        winning_agents=state.winning_agents,
        timestamps={**state.timestamps, state.robot: now},
        digests={**state.digests, state.robot: digest(state)},
    )


def hear(state: AllocationState, bid: Bid) -> tuple[AllocationState, bool]:
    """Take in a neighbour's word: phase 2. Also says whether a winner or a winning bid changed.

    What is not newer than everything known of its sender is dropped, and so is the word of a robot that is
    not of the team. Tasks lost to others stay in the bundle until `build_bundle`. A sender that does not know
    of a task says nothing of it but that it does not hold it itself.
    """
    k = bid.robot
    if k not in state.team or k == state.robot:
        return state, False
    if bid.time <= state.timestamps.get(k, -np.inf):
        return state, False
    lost = state.lost - {k}
    rank = {robot: number for number, robot in enumerate(state.team) if robot not in lost}
    bids, agents = dict(state.winning_bids), dict(state.winning_agents)
    changed = False
    for task in sorted(agents.keys() | bid.winning_agents.keys()):
        z_i, z_k = agents.get(task), bid.winning_agents.get(task)
        if bid.tasks is not None and z_k is None and z_i != k and task_of(task) not in bid.tasks:
            continue
        if z_k is not None and z_k not in rank:
            z_k = None  # a robot that nobody knows wins nothing
        y_i, y_k = bids.get(task, 0.0), 0.0 if z_k is None else bid.winning_bids[task]
        if z_i == z_k and y_i == y_k:
            continue
        action = verdict(
            rank[state.robot],
            rank[k],
            NOBODY if z_i is None else rank[z_i],
            y_i,
            NOBODY if z_k is None else rank[z_k],
            y_k,
            state.timestamps.get(z_i or "", -np.inf),
            bid.timestamps.get(z_i or "", -np.inf),
            state.timestamps.get(z_k or "", -np.inf),
            bid.timestamps.get(z_k or "", -np.inf),
        )
        if action == LEAVE:
            continue
        changed = True
        if action == UPDATE and z_k is not None:
            bids[task], agents[task] = y_k, z_k
        else:
            bids.pop(task, None)
            agents.pop(task, None)
    known, digests = dict(state.timestamps), dict(state.digests)
    for robot, time in bid.timestamps.items():
        if robot in rank and robot != state.robot and time > known.get(robot, -np.inf):
            known[robot] = time
            if robot in bid.digests:
                digests[robot] = bid.digests[robot]
    heard = replace(
        state, winning_bids=bids, winning_agents=agents, timestamps=known, digests=digests, lost=lost
    )
    return heard, changed


def agreed(state: AllocationState) -> bool:
    """Whether all robots that are not lost were last known to believe what this one believes.

    Once that is so for every robot and nothing is underway any more, the allocation is final: no robot has
    anything left to bid. Before that it may still be taken back by a word that is underway.
    """
    own = digest(state)
    return all(
        state.digests.get(robot) == own
        for robot in state.team
        if robot != state.robot and robot not in state.lost
    )


def digest(state: AllocationState) -> int:
    """A number that stands for all winning agents and winning bids."""
    text = "\n".join(
        f"{task} {state.winning_agents[task]} {state.winning_bids[task]!r}"
        for task in sorted(state.winning_agents)
    )
    return zlib.crc32(text.encode())


def lose(state: AllocationState, robot: str) -> AllocationState:
    """A robot is gone: its tasks are free, and others' words of its bids do not count until it speaks."""
    if robot == state.robot or robot not in state.team:
        return state
    freed = {task for task, winner in state.winning_agents.items() if winner == robot}
    return _without(replace(state, lost=state.lost | {robot}), freed)


def found(state: AllocationState, robot: str) -> AllocationState:
    """A robot that was taken for gone is there after all: what others say of its bids counts again."""
    return replace(state, lost=state.lost - {robot})


def recalled(state: AllocationState, tasks: Iterable[str], bids: Iterable[Bid]) -> AllocationState:
    """With the winners of tasks that the robot has just come to know, as these said themselves.

    Args:
        state: of the robot.
        tasks: that it knows of now; those that have a winner keep it.
        bids: what each other robot said last.
    """
    winning_bids, agents = dict(state.winning_bids), dict(state.winning_agents)
    rank = {robot: number for number, robot in enumerate(state.team) if robot not in state.lost}
    for task in tasks:
        if task in state.winning_agents:
            continue
        for bid in bids:
            if bid.winning_agents.get(task) != bid.robot or bid.robot not in rank:
                continue
            holder = rank[agents[task]] if task in agents else NOBODY
            y = bid.winning_bids[task]
            if beats(y, rank[bid.robot], winning_bids.get(task, 0.0), holder):
                winning_bids[task], agents[task] = y, bid.robot
    return replace(state, winning_bids=winning_bids, winning_agents=agents)


def release(state: AllocationState) -> AllocationState:
    """Give up all own tasks, to bid anew when scores have changed much."""
    state = replace(state, bundle=(), path=())
    return _without(state, {t for t, winner in state.winning_agents.items() if winner == state.robot})


def _without(state: AllocationState, tasks: Iterable[str]) -> AllocationState:
    """With nobody winning these tasks."""
    drop = frozenset(tasks)
    return replace(
        state,
        winning_bids={task: y for task, y in state.winning_bids.items() if task not in drop},
        winning_agents={task: z for task, z in state.winning_agents.items() if task not in drop},
    )
