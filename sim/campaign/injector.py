"""Carries out a schedule of faults in a virtual-time run, and writes down what truly happened."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Literal

import msgspec

from agents.invariants.history import Places, RunHistory, Said, Size, Used
from agents.wire.messages import Message
from agents.wire.topics import HEALTH, PLAN, POSE, TOPICS, Topic
from planner.plan import PlanProblem
from sim.campaign import faults as f
from sim.campaign.onlooker import Onlooker, Turn
from sim.engine.nodes import Life, Node
from sim.network.conditions import NetworkConditions

if TYPE_CHECKING:
    from sim.engine.engine import Engine

LOOK_S = 0.2  # between two looks at where the robots are
RESTART_S = 1.0  # until a process that ended by itself is started again


class Injector(Onlooker):
    """Give it to an Engine, then call `begin` with that before it runs."""

    def __init__(self, history: RunHistory, schedule: f.Schedule) -> None:
        self.history = history
        self.schedule = schedule
        self._armed: list[f.Kill] = []
        self._weather: list[NetworkConditions] = []
        self._waiting: set[str] = set()  # dead processes that will be started again

    def __repr__(self) -> str:
        return f"Injector(seed={self.schedule.seed}, faults={len(self.schedule.faults)})"

    def begin(self, engine: Engine) -> None:
        """Plan everything."""
        self._engine = engine
        self._set_weather()
        for fault in self.schedule.faults:
            if isinstance(fault, f.Clock) and fault.at == 0.0:
                self._strike(fault)
            elif not isinstance(fault, f.Join) or fault.at > 0.0:
                engine.after(fault.at, partial(self._strike, fault))
        self._look()

    def finish(self) -> RunHistory:
        """The run is over."""
        engine, history = self._engine, self.history
        history.tell(engine.clock.now(), "end")
        for node in engine.nodes.values():
            if node.life is not Life.OFF:
                self._queues(node)
        for name, ledger in engine.ledgers.items():
            history.ledgers[name] = list(ledger.replay(engine.team.mission.team))
        return history

    # What the engine tells

    def said(self, node: Node, topic: Topic, message: Message) -> None:
        if topic is not HEALTH:
            self.history.said.append(Said(self._now(), topic.name, message))

    def lived(self, node: Node, turn: Turn) -> None:
        self.history.tell(self._now(), turn, node.name, role=node.role, boot=node.boot)
        if turn == "down":
            self._queues(node)
            if node.name in self._engine.full and node.name not in self._waiting:
                self._back(node.name, RESTART_S)

    def at(self, node: Node, point: str) -> None:
        for kill in self._armed:
            if kill.who == node.name and kill.point == point:
                self._armed.remove(kill)
                self._kill(kill)
                return

    def asked(self, node: Node, problem: PlanProblem) -> None:
        robot = getattr(node, "robot", None)
        if robot is None:
            return
        now, poses = node.clock.now(), robot.belief.poses
        for other in problem.others:
            if other.version < 0 and other.robot in poses:
                age = now - poses[other.robot].time
                self.history.used.append(Used(self._now(), node.name, POSE.name, other.robot, age))
            elif other.version >= 0:
                self.history.used.append(Used(self._now(), node.name, PLAN.name, other.robot, 0.0))

    # Faults

    def _strike(self, fault: f.AnyFault) -> None:
        engine, network, history = self._engine, self._engine.network, self.history
        now = self._now()
        if isinstance(fault, f.Weather):
            self._weather.append(fault.conditions)
            self._set_weather()
            engine.after(fault.until - now, partial(self._clear, fault.conditions))
        elif isinstance(fault, f.Cut):
            ways = [(fault.from_, fault.to)] + ([] if fault.one_way else [(fault.to, fault.from_)])
            for sources, sinks in ways:
                network.cut(sources, sinks)
                self._tell_cut("cut", sources, sinks)
                engine.after(fault.until - now, partial(self._heal, sources, sinks))
        elif isinstance(fault, f.RouterDown):
            names = tuple(engine.nodes)
            network.cut(names, names)
            self._tell_cut("cut", names, names)
            engine.after(fault.until - now, partial(self._heal, names, names))
        elif isinstance(fault, f.Kill):
            if fault.point:
                self._armed.append(fault)
            elif engine.nodes[fault.who].life is not Life.OFF:
                self._kill(fault)
        elif isinstance(fault, f.Stop):
            self._stop(fault)
        elif isinstance(fault, f.Slow):
            engine.nodes[fault.who].lag_s = fault.every_s
            history.tell(now, "slow", fault.who, value=fault.every_s)
            engine.after(fault.until - now, partial(self._quick, fault.who))
        elif isinstance(fault, f.DiskFull):
            engine.full.add(fault.who)
            history.tell(now, "full", fault.who)
            engine.after(fault.until - now, partial(self._free, fault.who))
        elif isinstance(fault, f.Clock):
            computer = engine.nodes[fault.who].computer
            computer.offset, computer.drift = fault.offset, fault.drift
            history.tell(now, "clock", fault.who, value=fault.offset)
        else:
            for name in fault.who:
                self._start(name)

    def _kill(self, kill: f.Kill) -> None:
        self._engine.nodes[kill.who].kill()
        if kill.back_after is not None:
            self._back(kill.who, kill.back_after)

    def _back(self, who: str, delay: float) -> None:
        self._waiting.add(who)
        self._engine.after(delay, partial(self._start, who))

    def _start(self, who: str) -> None:
        self._waiting.discard(who)
        node = self._engine.nodes[who]
        if node.life is Life.OFF:
            self._engine.network.answer(who)
            node.start()
            node.wake()

    def _stop(self, fault: f.Stop) -> None:
        engine, network = self._engine, self._engine.network
        node = engine.nodes[fault.who]
        if node.life is not Life.RUNNING:
            return
        node.stop()
        boot = node.boot
        silent = engine.clock.now() + network.conditions.lease_s < fault.until

        def give_up() -> None:
            if node.life is Life.STOPPED and node.boot == boot:
                network.silence(fault.who)

        def go_on() -> None:
            if node.boot == boot and node.life is Life.STOPPED:
                network.answer(fault.who)
                node.go_on()

        if silent:
            engine.after(network.conditions.lease_s, give_up)
        engine.after(fault.until - engine.clock.now(), go_on)

    def _heal(self, sources: tuple[str, ...], sinks: tuple[str, ...]) -> None:
        self._engine.network.heal(sources, sinks)
        self._tell_cut("healed", sources, sinks)

    def _tell_cut(
        self, what: Literal["cut", "healed"], sources: tuple[str, ...], sinks: tuple[str, ...]
    ) -> None:
        now = self._now()
        for a in sources:
            for b in sinks:
                if a != b:
                    self.history.tell(now, what, a, other=b)

    def _quick(self, who: str) -> None:
        self._engine.nodes[who].lag_s = 0.0
        self.history.tell(self._now(), "quick", who)

    def _free(self, who: str) -> None:
        self._engine.full.discard(who)
        self.history.tell(self._now(), "free", who)

    def _clear(self, conditions: NetworkConditions) -> None:
        self._weather.remove(conditions)
        self._set_weather()

    def _set_weather(self) -> None:
        """The last that began holds. What may be lost for good, and what only comes later, is told."""
        conditions = self._weather[-1] if self._weather else f.CALM
        lease_s = self.history.mission.link.lease_s
        self._engine.network.conditions = msgspec.structs.replace(conditions, lease_s=lease_s)
        lost = conditions.corruption + (conditions.loss if conditions.datagrams else 0.0)
        now = self._now()
        if lost:
            self.history.tell(now, "lossy", value=lost)
        else:
            self.history.tell(now, "calm")
        late = conditions.late_s if conditions.late else 0.0
        self.history.tell(now, "delay", value=late + conditions.delay_s + 10.0 * conditions.jitter_s)

    # What is looked at

    def _look(self) -> None:
        engine, now = self._engine, self._now()
        where = {}
        for node in engine.robots:
            x, y, z = node.vehicle.truly().pose[:3].tolist()
            where[node.name] = (x, y, z)
        self.history.places.append(Places(now, where))
        engine.after(LOOK_S, self._look)

    def _queues(self, node: Node) -> None:
        now = self._now()
        for topic, peak in node.transport.peaks.items():
            bound = float(TOPICS[topic].queue)
            self.history.sizes.append(Size(now, node.name, node.boot, f"queue of {topic}", peak, bound))

    def _now(self) -> float:
        return self._engine.clock.now()
