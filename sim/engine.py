"""The virtual-time engine: the real Robot and Fusion objects of a team on a simulated network.

One heap of things to do, in time order; time jumps from one to the next. With one mission and seed every
message is the same, bit for bit: `Engine.log_hash` says so.
"""

import hashlib
import heapq
from collections import OrderedDict
from collections.abc import Callable
from itertools import count

from agents import codec
from agents.clock import VirtualClock
from agents.histogram import Histogram
from agents.ledger import Ledger
from agents.machine import Action, Heard, Planned, Publish, RequestPlan, Store
from agents.messages import EventMessage, Message, PosteriorMessage
from agents.scoreboard import Scoreboard
from agents.seeds import generator
from agents.team import Team
from agents.topics import EVENT, HEALTH, TOPICS, Topic
from sim.network import NetworkConditions, SimulatedNetwork
from sim.nodes import FusionNode, Node, OperatorNode, RobotNode
from sim.planning import PlanService

UNDERWAY = 256  # messages whose bytes are remembered
GRACE_S = 1.0  # the run goes on this long after the last target was found


class Engine:
    """One run of one mission and seed."""

    def __init__(
        self,
        team: Team,
        seed: int,
        conditions: NetworkConditions | None = None,
        ledger: Ledger | None = None,
        record: Callable[[Topic, Message], None] | None = None,
    ) -> None:
        self.team = team
        self.seed = seed
        self.clock = VirtualClock()
        self.events: list[str] = []
        self.world = team.world(seed)
        self.scoreboard = Scoreboard(team.mission, seed, "virtual", self.world)
        self._record = record
        self._ledger = ledger
        self._digest = hashlib.sha256()
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()
        self._stop_at = team.mission.duration_s
        self._underway: OrderedDict[bytes, Message] = OrderedDict()
        self._network = SimulatedNetwork(
            conditions or NetworkConditions(), generator(seed, "network"), self.after
        )
        self.planning = PlanService(team.planner, self.after)
        self.capture_to_posterior_ms = Histogram()
        self.fusion = FusionNode(self)
        self.robots = [RobotNode(self, robot.id) for robot in team.mission.robots]
        self._nodes: list[Node] = [self.fusion, *self.robots]
        if team.mission.statements:
            self._nodes.append(OperatorNode(self))

    def __repr__(self) -> str:
        return f"Engine({self.team.mission.name}, seed={self.seed}, now={self.clock.now():.3f})"

    @property
    def network(self) -> SimulatedNetwork:
        return self._network

    def decode(self, topic: Topic, payload: bytes, *, team: str, sender: str) -> Message:
        """As `codec.decode`; bytes that an agent of this run just sent are known without looking again."""
        message = self._underway.get(payload)
        if message is not None and message.sender == sender and isinstance(message, topic.message):
            return message
        return codec.decode(topic, payload, team=team, sender=sender)

    @property
    def log_hash(self) -> str:
        """Of every message of the run but health (which tells of the machine that ran it)."""
        return self._digest.hexdigest()

    def after(self, delay: float, action: Callable[[], None]) -> None:
        """Do something `delay` seconds from now."""
        heapq.heappush(self._heap, (self.clock.now() + delay, next(self._order), action))

    def run(self) -> Scoreboard:
        """To the end of the mission's duration, or until all targets are found."""
        for node in self._nodes:
            node.wake()
        while self._heap:
            time, _, action = heapq.heappop(self._heap)
            if time > self._stop_at:
                break
            self.clock.advance_to(time)
            action()
        for node in self._nodes:
            self.publish(node, HEALTH, node.health())
        return self.scoreboard

    def perform(self, node: Node, action: Action) -> None:
        """Carry out what a node's agent wants of the world."""
        if isinstance(action, Publish):
            self.publish(node, action.topic, action.message)
        elif isinstance(action, RequestPlan):
            assert isinstance(node, RobotNode)
            self.planning.request(action.problem, lambda plan: node.tell(Planned(action.number, plan)))
        elif isinstance(action, Store) and self._ledger is not None:
            self._ledger.store(action.entries)

    def publish(self, node: Node, topic: Topic, message: Message) -> None:
        """Send, keep score and log."""
        payload = codec.encode(message)
        self._underway[payload] = message
        if len(self._underway) > UNDERWAY:
            self._underway.popitem(last=False)
        now = self.clock.now()
        if topic is not HEALTH:
            self._digest.update(f"{now!r} {topic.name} {message.sender} ".encode())
            self._digest.update(payload)
        if topic is EVENT and isinstance(message, EventMessage):
            self.events.append(f"{now:8.2f} {message.sender}: {message.text}")
        self.scoreboard.hear(Heard(TOPICS[topic.name], message), now)
        if self._record is not None:
            self._record(topic, message)
        if isinstance(message, PosteriorMessage) and self.team.mission.stop_when_all_found:
            self._stop_when_all_found(now)
        node.transport.publish(topic, payload)

    def _stop_when_all_found(self, now: float) -> None:
        """The end comes a little after all is found, unless a late set takes a finding back."""
        end = self.team.mission.duration_s
        if not self.scoreboard.all_found:
            self._stop_at = end
        elif self._stop_at == end:
            self._stop_at = min(end, now + GRACE_S)
