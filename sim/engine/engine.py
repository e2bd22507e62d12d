"""The virtual-time engine: the real Robot and Fusion objects of a team on a simulated network.

One heap of things to do, in time order; time jumps from one to the next. With one mission and seed every
message is the same, bit for bit: `Engine.log_hash` says so. Processes can be killed, stopped and started
again while it runs (sim.campaign.faults).
"""

import hashlib
import heapq
from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from functools import partial
from itertools import count

from agents.clock import VirtualClock
from agents.health.histogram import Histogram
from agents.ledger.ledger import Ledger
from agents.machine import (
    Action,
    Event,
    Heard,
    Keep,
    Planned,
    Publish,
    Reckon,
    Reckoned,
    Release,
    RequestPlan,
    Store,
)
from agents.seeds import generator
from agents.swarm.scoreboard import Scoreboard
from agents.team import Team
from agents.wire import codec
from agents.wire.messages import EstimateMessage, EventMessage, LedgerEntry, MeasurementSetMessage, Message
from agents.wire.topics import EVENT, HEALTH, TOPICS, Topic
from planner.plan import Plan
from sim.campaign.onlooker import Onlooker
from sim.engine.nodes import Killed, Life, Node
from sim.engine.planning import PlanService
from sim.engine.robot_node import RobotNode, neighbours
from sim.engine.service_nodes import FusionNode, OperatorNode, ViewerNode
from sim.network.network import Near, NetworkConditions, SimulatedNetwork

UNDERWAY = 256  # messages whose bytes are remembered
FUSION = "fusion"  # the name of a team's first
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
        *,
        ledgers: Mapping[str, Ledger] | None = None,
        viewer: bool = False,
        absent: Collection[str] = (),
        onlooker: Onlooker | None = None,
        clocks: bool = False,
    ) -> None:
        """`ledger` is the first fusion's; `ledgers` are those of all, by name; else they are in memory.

        The `absent` processes are not started.
        """
        self.team = team
        self.seed = seed
        self.clock = VirtualClock()
        self.events: list[str] = []
        self.world = team.world(seed)
        self.scoreboard = Scoreboard(team.mission, seed, "virtual", self.world)
        self._record = record
        self.onlooker = onlooker or Onlooker()
        self.clocks = clocks  # robots have their own, and look how far they are off
        self.ledgers = dict(ledgers or {name: Ledger() for name in team.mission.fusions()})
        if ledger is not None:
            self.ledgers[FUSION] = ledger
        self.outboxes: dict[str, dict[tuple[str, int], LedgerEntry]] = {}  # robots' disks, by robot
        self.full: set[str] = set()  # fusions whose disk takes nothing more
        self._digest = hashlib.sha256()
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()
        self._stop_at = team.mission.duration_s
        self._underway: OrderedDict[bytes, Message] = OrderedDict()
        self._network = SimulatedNetwork(
            conditions or NetworkConditions(),
            generator(seed, "network"),
            self.after,
            self.clock.now,
            self._near,
        )
        self.planning = PlanService(team.planner, self.after)
        self.capture_to_posterior_ms = Histogram()
        fusions = [FusionNode(self, name) for name in self.ledgers]
        self.fusion = fusions[0]
        self.robots = [RobotNode(self, robot.id) for robot in team.mission.robots]
        nodes: list[Node] = [*fusions, *self.robots]
        if team.mission.statements or team.mission.requests:
            nodes.append(OperatorNode(self))
        if viewer:
            nodes.append(ViewerNode(self))
        self.nodes = {node.name: node for node in nodes}
        self._absent = frozenset(absent)
        self._near_at, self._neighbours = -1, neighbours([], 0.0)

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
        present = [node for node in self.nodes.values() if node.name not in self._absent]
        for node in present:
            node.start()
        for node in present:
            node.wake()
        while self._heap:
            time, _, action = heapq.heappop(self._heap)
            if time > self._stop_at:
                break
            self.clock.advance_to(time)
            action()
        for node in self.nodes.values():
            if node.life is Life.RUNNING:
                self.publish(node, HEALTH, node.health())
        return self.scoreboard

    def perform(self, node: Node, action: Action) -> None:
        """Carry out what a node's agent wants of the world.

        Raises:
            Killed: if the process died of it, or a fault struck it here.
        """
        if isinstance(action, Publish):
            self._point(node, f"before {action.topic.name}")
            self.publish(node, action.topic, action.message)
            self._point(node, f"after {action.topic.name}")
        elif isinstance(action, RequestPlan):
            self.onlooker.asked(node, action.problem)
            self.planning.request(action.problem, partial(self._planned, node, node.boot, action.number))
        elif isinstance(action, Store) and node.role == "robot":
            self._point(node, "before store")
            self.outboxes.setdefault(node.name, {}).update({(e.boot, e.sequence): e for e in action.entries})
            self._point(node, "after store")
        elif isinstance(action, Release):
            for place in action.places:
                self.outboxes.setdefault(node.name, {}).pop(place, None)
        elif isinstance(action, Reckon):
            action.work()
            self.after(0.0, partial(self._tell, node, node.boot, Reckoned(action.number)))
        elif isinstance(action, Store):
            self._point(node, "before store")
            if node.name in self.full:
                # What the ledger raises ends the process; robots still have what it did not acknowledge.
                self.events.append(f"{self.clock.now():8.2f} {node.name}: the disk is full")
                node.kill()
                raise Killed
            self.ledgers[node.name].store(action.entries, action.expired, action.revived)
            self._point(node, "after store")
        elif isinstance(action, Keep):
            self._point(node, "before checkpoint")
            self.ledgers[node.name].keep(action.checkpoint, action.kept)
            self._point(node, "after checkpoint")

    def _point(self, node: Node, name: str) -> None:
        self.onlooker.at(node, name)
        if node.life is not Life.RUNNING:
            raise Killed

    def left_in_outbox(self, robot: str) -> list[MeasurementSetMessage]:
        """What the earlier boots of a robot took and no fusion acknowledged."""
        left = self.outboxes.get(robot, {}).values()
        return [entry for entry in left if isinstance(entry, MeasurementSetMessage)]

    def _planned(self, node: Node, boot: str, number: int, plan: Plan) -> None:
        self._tell(node, boot, Planned(number, plan))

    def _tell(self, node: Node, boot: str, event: Event) -> None:
        if node.boot == boot and node.life is not Life.OFF:
            node.tell(event)

    def _near(self) -> Near:
        """Whom each robot's radio reaches, as of the last second."""
        second = int(self.clock.now())
        if self._near_at != second:
            self._near_at, self._neighbours = (
                second,
                neighbours(self.robots, self._network.conditions.reach_m),
            )
        return self._neighbours

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
        self.onlooker.said(node, topic, message)
        if isinstance(message, EstimateMessage) and self.team.mission.stop_when_all_found:
            self._stop_when_all_found(now)
        node.transport.publish(topic, payload)

    def _stop_when_all_found(self, now: float) -> None:
        """The end comes a little after all is found, unless a late set takes a finding back."""
        end = self.team.mission.duration_s
        if not self.scoreboard.all_found:
            self._stop_at = end
        elif self._stop_at == end:
            self._stop_at = min(end, now + GRACE_S)
