"""One robot's part in settling who does what: CBBA with the others, over whatever network there is.

A state machine of its own, stepped by the Robot. It hears the others' words (bids), makes tasks and values
them anew about once a second, bids, and says its word: soon after its own tasks changed, a little later when
it only knows more of others', and at every heartbeat otherwise, for ever, since nothing is acknowledged and
any word may be lost. What it holds of the others is in `agents.allocation.others`, what operators asked for
in `agents.allocation.requests`, how it looks from outside in `agents.allocation.record`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.allocation.others import TeamWords
from agents.allocation.record import Record
from agents.allocation.requests import RequestBook
from agents.machine import Action, Publish, Stamp
from agents.mission.mission import Mission
from agents.wire.messages import BidMessage, RequestMessage
from agents.wire.topics import BID
from agents.wire.transport import PeerChange
from estimator.arrays import FloatArray
from estimator.sensor import SensorModel
from planner.allocation.cbba import AllocationState, build_bundle, recalled, word
from planner.allocation.desk import Assignment, Desk
from planner.allocation.score import RobotScore
from planner.allocation.slots import task_of
from planner.allocation.tasks import Task
from planner.allocation.valuation import slot_names
from planner.plan import PlanProblem, Trajectory

RELAY_ROUNDS = 4  # a word that only passes on others' news waits this many rounds

View = Callable[[], tuple[PlanProblem, Trajectory | None]]  # what is believed now, and the way robot is on


@dataclass(frozen=True, slots=True)
class _Market:
    """What there is to bid for."""

    tasks: tuple[Task, ...] = ()
    slots: tuple[str, ...] = ()
    score: RobotScore | None = None


class Allocation:
    """Who does what, as one robot believes. `step` after everything was heard."""

    def __init__(
        self,
        mission: Mission,
        robot: str,
        desk: Desk,
        sensors: Mapping[str, SensorModel],
        now: float,
        patience: float = 1.0,
    ) -> None:
        """`patience` stretches the times for teams that run faster than the wall."""
        self.robot = robot
        box = mission.box()
        reach = float(np.linalg.norm(box.high - box.low))
        self._able = {r.id: frozenset(r.capabilities) for r in mission.robots}
        self.requests = RequestBook(sensors, self._able, reach, box.dimension)
        self._desk = desk
        self._patience = max(1.0, patience)
        rules = desk.rules
        self.team = TeamWords(
            AllocationState.start(robot, list(self._able), rules.capacity),
            heartbeat_s=rules.heartbeat_s * self._patience,
            silence_s=rules.silence_s * self._patience,
        )
        self.record = Record(robot, desk.rules.heartbeat_s * self._patience)
        self._market = _Market()
        self._renew_at = now
        self._said_at = -np.inf
        self._said: tuple[Any, ...] = ()  # what the last word said of this robot's own tasks
        self._passed_on: tuple[Any, ...] = ()  # and of all others'
        self._greet = False  # somebody is there who has not heard this robot
        self._stale = True  # something changed that bids depend on

    def __repr__(self) -> str:
        return f"Allocation({self.robot}, path={self.path}, {self.team!r})"

    @property
    def state(self) -> AllocationState:
        """Bundle, path, winning bids and agents."""
        return self.team.state

    @property
    def path(self) -> tuple[str, ...]:
        """Own tasks in the order of execution."""
        return tuple(task_of(slot) for slot in self.state.path)

    @property
    def first(self) -> str:
        """The task to be at now; "" if there is none."""
        return self.path[0] if self.state.path else ""

    def assignment(self) -> Assignment:
        """What the planner takes as given. Tasks that the robot cannot do are left out."""
        able = self._able[self.robot]
        tasks = tuple(task for task in self._market.tasks if {task.kind, *task.needs} <= able)
        return Assignment(tasks, self.path)

    def yields(self, mine: str, theirs: str, other: str) -> bool:
        """Whether this robot, on a plan for task `mine`, gives way to another's for `theirs`.

        Who plans for a task that it holds goes before who only helps; else the first in the team's order.
        """
        ours = bool(mine) and mine in self.path
        held = any(z == other and task_of(s) == theirs for s, z in self.state.winning_agents.items())
        if ours != held:
            return held
        return self.state.team.index(other) < self.state.team.index(self.robot)

    def counters(self) -> dict[str, int]:
        """For health."""
        return dict(self.record.counters + self.team.counters)

    def gauges(self) -> dict[str, float]:
        """For health."""
        return self.record.gauges()

    # What is heard

    def hear(self, now: float, message: BidMessage | RequestMessage) -> None:
        """Another robot's word, or an operator's request."""
        if isinstance(message, RequestMessage):
            news = self.requests.hear([message.wish])
        else:
            news = self.requests.hear(message.wishes)
            self._stale |= self.team.hear(now, message)
        if news:
            self._renew_at, self._greet = min(self._renew_at, now), True

    def peer(self, now: float, change: PeerChange) -> None:
        """A robot's liveliness token came or went."""
        if change.alive:
            self._greet |= self.team.came(now, change.peer.id, change.peer.boot)
        else:
            self._stale |= self.team.went(change.peer.id, change.peer.boot)

    def looked(self, time: float, robot: str, pose: FloatArray) -> None:
        """A robot measured from a pose (4,)."""
        seen = self.requests.looked(time, robot, pose)
        if seen:
            done = [name for name in seen if self.requests.done(name)]
            self.record.done(done if robot == self.robot else ())
            self._renew_at, self._greet = min(self._renew_at, time), True

    def renew(self, now: float) -> None:
        """Make tasks and bids anew at the next step, because a plan is to be made."""
        self._renew_at = min(self._renew_at, now)

    # What is said

    def next_wake(self) -> float:
        """When `step` must be called even if nothing is heard."""
        return min(self._renew_at, self._due(), self.team.next_check(), self.record.next_news())

    def step(self, now: float, stamp: Stamp, view: View) -> list[Action]:
        """Bid, after what was heard up to `now`; answer what to publish."""
        self._stale |= self.team.check(now)
        if now >= self._renew_at:
            self._renew(now, view)
        if self._stale:
            self._bid()
        news = self.record.look(now, self.state, self.team)
        actions: list[Action] = [self.record.event(stamp, now, text) for text in news]
        if now >= self._due():
            actions.append(Publish(BID, self._word(now, stamp)))
        return actions

    def _renew(self, now: float, view: View) -> None:
        problem, way = view()
        known = self.team.known_places()
        known |= {task.name: task.place for task in self._market.tasks}
        tasks = self._desk.tasks(problem, self.requests.open(), known)
        score = self._desk.score(
            problem,
            tasks,
            way=way,
            held=self.first,
            capabilities=self._able[self.robot],
            barred=self.requests.looked_at(self.robot),
        )
        slots = tuple(slot_names(tasks))
        self.team.state = recalled(self.state, slots, self.team.words())
        self._market = _Market(tasks, slots, score)
        self._renew_at = now + self._desk.rules.renew_s
        self._stale = True

    def _bid(self) -> None:
        self._stale = False
        market = self._market
        if market.score is None:
            return
        self.team.state = build_bundle(self.state, market.slots, market.score)

    def _contents(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """What the word would say of this robot's tasks, and of others'."""
        state = self.state
        own = {slot: state.winning_bids[slot] for slot in state.bundle}
        others = {s: z for s, z in state.winning_agents.items() if z != self.robot}
        return (state.path, own), (others,)

    def _due(self) -> float:
        """When the next word is to be said."""
        rules = self._desk.rules
        own, others = self._contents()
        wait = rules.heartbeat_s
        if self._greet or own != self._said:
            wait = rules.round_s
        elif others != self._passed_on:
            wait = min(wait, RELAY_ROUNDS * rules.round_s)
        return self._said_at + wait * self._patience

    def _word(self, now: float, stamp: Stamp) -> BidMessage:
        self._said, self._passed_on = self._contents()
        self._said_at, self._greet = now, False
        bid = word(self.state, self.team.tick(now))
        tasks = self._market.tasks
        d = len(tasks[0].place) if tasks else 2
        return BidMessage(
            **stamp.header(BID, now),
            said=bid.time,
            tasks=[task.name for task in tasks],
            places=np.array([task.place for task in tasks]).reshape(len(tasks), d),
            path=list(self.path),
            winning_bids=dict(bid.winning_bids),
            winning_agents=dict(bid.winning_agents),
            timestamps=dict(bid.timestamps),
            digests=dict(bid.digests),
            wishes=list(self.requests.wishes()),
        )
