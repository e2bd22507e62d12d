"""How the vehicle's clock stands to ours, from TIMESYNC.

We say when we ask (ts1), it says when it heard (tc1, its own clock), and half of the round trip lies between.
Only answers that came nearly as fast as the fastest are used, and the offset follows them slowly, so that a
busy link does not shift capture times.
"""

from collections import deque

from bridges.mavlink.dialect import Message, mavlink

BURST = 8  # quick questions at the beginning
QUICK, SLOW = 0.1, 1.0  # s between questions
GAIN = 0.2
JUMP = 0.5  # s of offset that no clock drifts between two questions
LATE = 1.0  # s: a capture longer ago than this is not believed


class TimeSync:
    """Offset of one vehicle's clock. Pure: times come in."""

    def __init__(self, system: int, component: int = 1) -> None:
        self._target = (system, component)
        self._due = 0.0
        self._asked = 0
        self._trips: deque[float] = deque(maxlen=30)
        self.offset: float | None = None  # s, its clock minus ours
        self.round_trip: float | None = None  # s, of the fastest of late
        self.answers = 0
        self.jumps = 0  # how often its clock went back

    def __repr__(self) -> str:
        return f"TimeSync(offset={self.offset}, round_trip={self.round_trip}, answers={self.answers})"

    def reset(self) -> None:
        """It has started anew: its clock began at zero."""
        self.offset, self.round_trip, self._asked, self._due = None, None, 0, 0.0
        self._trips.clear()

    def step(self, now: float) -> list[Message]:
        """The question that is due."""
        if now < self._due:
            return []
        self._due = now + (QUICK if self._asked < BURST else SLOW)
        self._asked += 1
        return [mavlink.MAVLink_timesync_message(0, int(now * 1e9))]

    def hear(self, now: float, message: Message) -> list[Message]:
        """Answer a question, or learn from an answer."""
        if message.tc1 == 0:
            return [mavlink.MAVLink_timesync_message(int(now * 1e9), message.ts1)]
        trip = now - message.ts1 / 1e9
        if not 0 <= trip < LATE or message.tc1 < 0:  # an answer to somebody else
            return []
        self._trips.append(trip)
        self.round_trip = min(self._trips)
        if trip > 2 * self.round_trip + 0.002:
            return []
        offset = message.tc1 / 1e9 - (now - trip / 2)
        if self.offset is None:
            self.offset = offset
        elif abs(offset - self.offset) > JUMP:
            self.jumps += offset < self.offset  # forward it may be set, back it goes only with a new start
            self.offset = offset
        else:
            self.offset += GAIN * (offset - self.offset)
        self.answers += 1
        return []

    def captured(self, vehicle_time: float, arrived: float) -> float:
        """When the vehicle's clock showed `vehicle_time`, on ours; without a good offset, when it arrived."""
        if self.offset is None:
            return arrived
        time = vehicle_time - self.offset
        return time if arrived - LATE < time <= arrived else arrived
