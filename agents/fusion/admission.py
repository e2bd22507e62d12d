"""Which sets and soft observations the fusion takes, and what it says of those that it does not."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from agents.ledger.history import Identity, identity
from agents.mission.mission import Mission
from agents.mission.mission_checks import is_reserved
from agents.operator.statements import observation
from agents.seeds import generator
from agents.wire.messages import LedgerEntry, MeasurementSetMessage, SoftObservationMessage
from estimator.filter import Listening
from estimator.search import Search, SearchState
from estimator.sensor import SensorModel

MOST = 5000  # soft observations in one mission: more are a flood
_REMEMBERED = 256  # refused ones that are answered, once each; the rest are counted only
_AHEAD_S = 1.0  # a sender's clock may be this much ahead, or the rollback window if that is longer


class Refused(Exception):
    """Why an entry is not taken: a short fixed word for counting, and a sentence for whoever said it."""

    def __init__(self, reason: str, sentence: str) -> None:
        super().__init__(sentence)
        self.reason = reason


def about(entry: LedgerEntry) -> str:
    """The same as an event names it."""
    return f"{entry.sender}/{entry.boot}/{entry.sequence}"


class Admission:
    """Looks at each entry before it is stored. Counts refusals as rejected.REASON."""

    def __init__(
        self,
        mission: Mission,
        search: Search[Any],
        sensors: Mapping[str, SensorModel],
        counters: "Counter[str]",
    ) -> None:
        self._search = search
        self._sensors = sensors
        self._counters = counters
        self._ahead = max(_AHEAD_S, mission.fusion.rollback_s)
        self._answered: set[Identity] = set()

    def __repr__(self) -> str:
        return f"Admission(answered={len(self._answered)})"

    def refusal(self, entry: LedgerEntry, now: float, state: SearchState[Any], statements: int) -> str | None:
        """None if the entry is taken; else a sentence to be said, which is empty when it was said before.

        `state` is the newest estimate, `statements` how many soft observations were taken before.
        """
        try:
            if isinstance(entry, MeasurementSetMessage):
                self._check_set(entry, now)
            else:
                self._check_statement(entry, now, state, statements)
        except Refused as refused:
            self._counters[f"rejected.{refused.reason}"] += 1
            if isinstance(entry, MeasurementSetMessage) or identity(entry) in self._answered:
                return ""
            if len(self._answered) >= _REMEMBERED:
                return ""
            self._answered.add(identity(entry))
            return str(refused)
        return None

    def _check_set(self, entry: MeasurementSetMessage, now: float) -> None:
        sensor = self._sensors.get(entry.sender)
        if sensor is None:
            raise Refused("unknown_robot", "the mission has no such robot")
        if entry.measurements.shape[1] != sensor.measurement_size:
            raise Refused("measurement_size", "the robot's sensor measures something else")
        if entry.time > now + self._ahead:  # it would make the sets of all others late
            raise Refused("from_the_future", f"it is {entry.time - now:.1f} s ahead; set the clock right")

    def _check_statement(
        self, entry: SoftObservationMessage, now: float, state: SearchState[Any], statements: int
    ) -> None:
        # Robots and operators share the ledger's key, so no name may be both.
        if entry.sender in self._sensors or is_reserved(entry.sender):
            raise Refused("no_operator", f"{entry.sender} is no operator's name")
        filter = self._search.filter
        if not isinstance(filter, Listening):
            raise Refused("no_soft_observations", "the mission's filter takes no soft observations")
        if entry.time > now + self._ahead:
            raise Refused("from_the_future", f"it is {entry.time - now:.1f} s ahead; set the clock right")
        if statements >= MOST:
            raise Refused("too_many", f"there were {MOST} statements already")
        try:
            # A trial on the newest estimate: what a filter has to say against it, it says now.
            statement = observation(entry, self._search.area.dimension)
            filter.observe(state.filter_state, statement, generator(0, "trial"))
        except ValueError as error:
            raise Refused("statement", str(error)[:300]) from None
