"""What one robot knows of the others from their words: who is there, and what each said last.

Who is gone is a matter of evidence. A robot whose liveliness token went is gone at once, so that its tasks
are soon taken over. Where tokens do not reach, words do: they carry when each robot last spoke, by that
robot's own clock, and a robot that goes on speaking to anybody who is in reach over others is not gone. What
was said before the token went, and is only now heard of, is no evidence: a robot must have spoken more than a
heartbeat later than was known when it went. Without a token it is gone again when three heartbeats bring no
newer word, and with a token (a hung process, a one-way link) after the mission's `silence_s`.
"""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from agents.wire.messages import BidMessage
from estimator.arrays import FloatArray
from planner.allocation.cbba import AllocationState, Bid, found, hear, lose

LATER = 1.2  # heartbeats by which a word must be newer than the last known, to be a sign of life
BEATS = 3.0  # heartbeats without a newer word after which a robot without a token is gone
TICK_S = 1e-6  # between two words of one robot at least
AHEAD_S = 1e6  # a time further ahead is no clock's that went wrong, but no time at all


class TeamWords:
    """The CBBA state of one robot, and what changes it from outside."""

    def __init__(self, state: AllocationState, *, heartbeat_s: float, silence_s: float) -> None:
        for other in state.team:
            if other != state.robot:
                state = lose(state, other)  # until it is heard
        self.state = state
        self.counters: Counter[str] = Counter()
        self._heartbeat = heartbeat_s
        self._silence = silence_s
        self._tokens: dict[str, set[str]] = {}  # boots whose token stands, by robot
        self._spoke: dict[str, float] = {}  # when a newer word of a robot was last heard of, by own clock
        self._last: dict[str, BidMessage] = {}  # each robot's newest word
        self._ticked = -np.inf  # time of the last word
        self._ahead = 0.0  # of this robot's clock, that words are given

    def __repr__(self) -> str:
        return f"TeamWords(here={sorted(set(self.state.team) - self.state.lost)})"

    def tick(self, now: float) -> float:
        """The time of this robot's next word: growing, also where its clock was set back or it was reborn."""
        self._ahead += max(0.0, self._ticked + TICK_S - (now + self._ahead))
        self._ticked = now + self._ahead
        return self._ticked

    def here(self, robot: str) -> bool:
        """Whether a robot counts as being there."""
        return robot in self.state.team and robot not in self.state.lost

    def came(self, now: float, robot: str, boot: str) -> bool:
        """A token stands; whether that is news of a robot of this team."""
        if robot not in self.state.team or robot == self.state.robot:
            return False
        self._tokens.setdefault(robot, set()).add(boot)
        self._spoke[robot] = now
        self.state = found(self.state, robot)
        return True

    def went(self, robot: str, boot: str) -> bool:
        """A token went; whether the robot is gone by that."""
        boots = self._tokens.get(robot, set())
        boots.discard(boot)
        return not boots and self._lose(robot)

    def hear(self, now: float, message: BidMessage) -> bool:
        """Take in a word; whether anything changed that own bids depend on."""
        robot, me = message.sender, self.state.robot
        times = {**message.timestamps, robot: message.said}
        if robot not in self.state.team or robot == me or max(times.values()) > now + AHEAD_S:
            self.counters["bids_refused"] += 1
            return False
        # What a former life of this robot said, with a clock further ahead, others must not believe for ever.
        self._ticked = max(self._ticked, times.get(me, -np.inf))
        before = self.state.lost
        for other, time in times.items():
            later = LATER * self._heartbeat if other in before else 0.0
            if other in self.state.team and time > self.state.timestamps.get(other, -np.inf) + later:
                self._spoke[other] = now
                if other in before:
                    self.state = found(self.state, other)
        if robot in self.state.lost or message.said <= self.state.timestamps.get(robot, -np.inf):
            self.counters["bids_too_late"] += 1
            return self.state.lost != before
        self._last[robot] = message
        self.state, changed = hear(self.state, _bid(message))
        return changed or self.state.lost != before

    def check(self, now: float) -> bool:
        """Take those for gone who have been silent for too long; whether any was."""
        silent = [robot for robot, until in self._patience() if now >= until]
        for robot in silent:
            self._lose(robot)
        return bool(silent)

    def next_check(self) -> float:
        """When `check` will find somebody gone, if nothing is heard until then."""
        return min((until for _, until in self._patience()), default=np.inf)

    def words(self) -> list[Bid]:
        """The newest word of everybody who is there."""
        return [_bid(message) for robot, message in sorted(self._last.items()) if self.here(robot)]

    def claims(self) -> dict[str, frozenset[str]]:
        """Slots that each other robot that is there last said to be its own."""
        return {
            robot: frozenset(slot for slot, winner in message.winning_agents.items() if winner == robot)
            for robot, message in sorted(self._last.items())
            if self.here(robot)
        }

    def known_places(self) -> dict[str, FloatArray]:
        """Where others say that tasks are; of two who mean different places by one name, the first."""
        places: dict[str, FloatArray] = {}
        for robot, message in sorted(self._last.items()):
            if self.here(robot):
                for name, place in zip(message.tasks, message.places, strict=True):
                    places.setdefault(name, place)
        return places

    def _patience(self) -> Iterable[tuple[str, float]]:
        for robot in self.state.team:
            if robot in self.state.lost or robot == self.state.robot:
                continue
            limit = self._silence if self._tokens.get(robot) else BEATS * self._heartbeat
            yield robot, self._spoke.get(robot, -np.inf) + limit

    def _lose(self, robot: str) -> bool:
        if not self.here(robot) or robot == self.state.robot:
            return False
        self.state = lose(self.state, robot)
        self.counters["robots_lost"] += 1
        return True


def _bid(message: BidMessage) -> Bid:
    return Bid(
        robot=message.sender,
        time=message.said,
        winning_bids=message.winning_bids,
        winning_agents=message.winning_agents,
        timestamps=message.timestamps,
        digests=message.digests,
        tasks=frozenset(message.tasks),
    )
