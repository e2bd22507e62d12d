"""Allocation agents that talk over a bad network in virtual time, with nothing else of a robot around them.

Tasks are real: clusters and unexplored regions of one field, valued by each robot's own desk. Words and
liveliness tokens go between robots as the links say; a robot may be killed, frozen, reborn, or have a clock
of its own.
"""

import heapq
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

import msgspec
import numpy as np

from agents.allocation.allocation import Allocation
from agents.allocation.ownership import Ownership
from agents.machine import Publish, Stamp
from agents.mission.mission import RobotTable
from agents.wire import codec
from agents.wire.messages import BidMessage, EventMessage, Message
from agents.wire.topics import BID, TOPICS
from agents.wire.transport import Peer, PeerChange
from planner.allocation.desk import BidRules, Desk
from planner.allocation.tasks import TaskRules
from planner.allocation.valuation import Worth
from planner.plan import PlanProblem, Trajectory
from tests.agents.fakes import mission
from tests.planner.problems import problem, team

SIDE = 100.0
LEASE_S = 0.5
RULES = BidRules(capacity=3, renew_s=1.0, round_s=0.05, heartbeat_s=0.5, silence_s=5.0)


class Node:
    """One robot's allocation agent and where it stands."""

    def __init__(self, hall: "Hall", name: str, place: tuple[float, float], boot: int, offset: float) -> None:
        self.name, self.boot, self.offset, self.place = name, f"b{boot}", offset, place
        self.alive, self.frozen = True, False
        self.inbox: list[Callable[[], None]] = []
        setup = hall.setup
        desk = Desk(name, setup, TaskRules(regions=hall.regions), Worth(), RULES)
        self.agent = Allocation(hall.mission, name, desk, setup.sensors, hall.now + offset)
        self.stamp = Stamp("t", name, self.boot)

    def view(self, hall: "Hall") -> tuple[PlanProblem, Trajectory | None]:
        start = (*self.place, 5.0)
        return problem(hall.setup, hall.seed, self.name, clusters=hall.clusters, start=start), None


class Hall:
    """`run` until a time; links say who hears whom."""

    def __init__(
        self,
        places: dict[str, tuple[float, float]],
        *,
        seed: int = 0,
        clusters: int = 5,
        regions: int = 4,
        loss: float = 0.0,
        delay: float = 0.01,
        offsets: dict[str, float] | None = None,
        silent_tokens: Iterable[tuple[str, str]] = (),
        **robots: dict[str, Any],
    ) -> None:
        """`silent_tokens`: pairs that never see each other's tokens. `robots`: further keys of a robot."""
        self.now, self.seed, self.clusters, self.regions = 0.0, seed, clusters, regions
        self.loss, self.delay = loss, delay
        names = sorted(places)
        tables = [
            RobotTable(id=name, start=[*places[name]], vehicle={}, sensor={}, **robots.get(name, {}))
            for name in names
        ]
        self.mission = msgspec.structs.replace(mission(), robots=tables)
        self.setup = team(2, names, side=SIDE, reach=6.0)
        self.links = {(a, b) for a in names for b in names if a != b}
        self.blind = {pair for a, b in silent_tokens for pair in ((a, b), (b, a))}
        self.words: list[tuple[float, BidMessage]] = []
        self.events: list[tuple[float, str]] = []
        self.ownership = Ownership()
        self._rng = np.random.default_rng([seed, 7])
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()
        self._offsets = offsets or {}
        self.nodes: dict[str, Node] = {}
        for name in names:
            self.join(name, places[name])

    # What happens to robots and links

    def join(self, name: str, place: tuple[float, float], boot: int = 0, offset: float | None = None) -> None:
        offset = self._offsets.get(name, 0.0) if offset is None else offset
        node = self.nodes[name] = Node(self, name, place, boot, offset)
        for other in self.nodes.values():
            if other is not node and other.alive:
                self._token(other, node, True)
                self._token(node, other, True)
        self._wake(node)

    def kill(self, name: str, lease: float = LEASE_S) -> None:
        """SIGKILL; the others see it `lease` seconds later."""
        node = self.nodes[name]
        node.alive = False
        self.at(lease, lambda: [self._token(other, node, False) for other in self._others(node)])

    def freeze(self, name: str) -> None:
        self.nodes[name].frozen = True

    def go_on(self, name: str) -> None:
        node = self.nodes[name]
        node.frozen = False
        for item in node.inbox:
            item()
        node.inbox.clear()
        self._wake(node)

    def cut(self, *groups: Iterable[str], lease: float = LEASE_S) -> None:
        """Nobody hears anybody of another group; tokens go after the lease."""
        sets = [set(group) for group in groups]
        before = set(self.links)
        self.links = {(a, b) for a, b in before if any(a in g and b in g for g in sets)}
        lost = before - self.links
        self.at(lease, lambda: self._tokens(lost, False))

    def heal(self, after: float = 0.1) -> None:
        """All hear all; tokens come back a little later."""
        every = {(a, b) for a in self.nodes for b in self.nodes if a != b}
        back = every - self.links
        self.links = every
        self.at(after, lambda: self._tokens(back, True))

    def request(self, message: Message) -> None:
        """An operator's word to everybody."""
        for node in self.nodes.values():
            self._deliver(node, message)

    def looked(self, robot: str, pose: tuple[float, ...]) -> None:
        """Everybody hears that a robot measured."""
        for node in self.nodes.values():
            node.agent.looked(self.now, robot, np.array(pose))
            self._wake(node)

    # Time

    def at(self, delay: float, action: Callable[[], object]) -> None:
        heapq.heappush(self._heap, (self.now + delay, next(self._order), action))

    def run(self, until: float) -> "Hall":
        while self._heap and self._heap[0][0] <= until:
            self.now, _, action = heapq.heappop(self._heap)
            action()
        self.now = until
        return self

    # What is so

    def owners(self) -> dict[str, list[str]]:
        """Who believes to hold each task, of those that live."""
        held: dict[str, list[str]] = {}
        for node in self.nodes.values():
            if node.alive:
                for slot in node.agent.state.bundle:
                    held.setdefault(slot, []).append(node.name)
        return held

    def tasks(self) -> set[str]:
        node = next(node for node in self.nodes.values() if node.alive)
        return {task.name for task in node.agent.assignment().tasks}

    def settled(self) -> bool:
        """Every task has one holder, and nobody thinks otherwise."""
        held = self.owners()
        live = [node for node in self.nodes.values() if node.alive]
        views = [dict(node.agent.state.winning_agents) for node in live]
        return all(len(who) == 1 for who in held.values()) and all(view == views[0] for view in views)

    # The wires

    def _others(self, node: Node) -> list[Node]:
        return [other for other in self.nodes.values() if other is not node and other.alive]

    def _tokens(self, pairs: set[tuple[str, str]], stands: bool) -> None:
        for a, b in sorted(pairs):
            if ((a, b) in self.links) == stands and self.nodes[a].alive and self.nodes[b].alive:
                self._token(self.nodes[b], self.nodes[a], stands)

    def _token(self, seer: Node, seen: Node, stands: bool) -> None:
        if (seer.name, seen.name) in self.blind or not seer.alive:
            return
        change = PeerChange(Peer("robot", seen.name, seen.boot), stands)
        self._take(seer, lambda: seer.agent.peer(self.now + seer.offset, change))

    def _take(self, node: Node, item: Callable[[], None]) -> None:
        if node.frozen:
            node.inbox.append(item)
        elif node.alive:
            item()
            self._wake(node)

    def _deliver(self, node: Node, message: Message) -> None:
        self._take(node, lambda: node.agent.hear(self.now + node.offset, message))  # type: ignore[arg-type]

    def _wake(self, node: Node) -> None:
        self.at(0.0, lambda: self._step(node))

    def _step(self, node: Node) -> None:
        if not node.alive or node.frozen or self.nodes[node.name] is not node:
            return
        for action in node.agent.step(self.now + node.offset, node.stamp, lambda: node.view(self)):
            assert isinstance(action, Publish)
            message = action.message
            if isinstance(message, EventMessage):
                self.events.append((self.now, f"{node.name}: {message.text}"))
                continue
            payload = codec.encode(message)
            said = codec.decode(TOPICS[BID.name], payload, team="t", sender=node.name)
            assert isinstance(said, BidMessage)
            self.words.append((self.now, said))
            self.ownership.hear(said, self.now)
            self._carry(node, said)
        wait = max(1e-4, node.agent.next_wake() - (self.now + node.offset))
        self.at(wait, lambda: self._step_if_due(node))

    def _step_if_due(self, node: Node) -> None:
        if node.agent.next_wake() <= self.now + node.offset + 1e-9:
            self._step(node)

    def _carry(self, node: Node, message: BidMessage) -> None:
        for other in self._others(node):
            if (node.name, other.name) in self.links and self._rng.random() >= self.loss:
                late = self.delay * (1.0 + self._rng.exponential(0.5))
                self.at(late, lambda other=other: self._deliver(other, message))  # type: ignore[misc]
