"""How far one clock is behind another, from questions and answers, with a bound that always holds.

An exchange is four readings, as in NTP (Mills 1991, section 3): the asker's clock when it asked, the other's
when it received and when it answered, the asker's when it heard. No message arrives before it is sent, so
each exchange encloses the offset between answered - heard and received - asked, however uneven the two ways
are; the width of that interval is the round trip. What encloses the offset in every exchange of the window
is then kept (Marzullo & Owicki 1983), each interval widened by what the clocks may have run apart since. The
middle is within half of the best round trip of the truth, and jitter costs nothing once one exchange in the
window was quick.

Intervals that have no common point say that a clock was set or ran faster than assumed: the oldest are then
forgotten until the rest agree.
"""

import math
from collections import deque
from dataclasses import dataclass

WINDOW = 64  # exchanges that are kept


@dataclass(frozen=True, slots=True)
class Exchange:
    """One question and its answer, seconds of two clocks."""

    asked: float  # by the asker's clock
    received: float  # by the other clock
    answered: float  # by the other clock, when the answer was sent
    heard: float  # by the asker's clock


class ClockOffset:
    """What must be added to the asker's clock to have the other's. Pure: it reads no clock itself."""

    def __init__(self, drift: float = 2e-4, window: int = WINDOW) -> None:
        """`drift`: the clocks run apart by at most this many seconds in a second."""
        self._drift = drift
        self._kept: deque[tuple[float, float, float]] = deque(maxlen=window)  # heard, low, high
        self.forgotten = 0  # exchanges that later ones contradicted

    def __repr__(self) -> str:
        return f"ClockOffset(kept={len(self._kept)}, forgotten={self.forgotten})"

    def add(self, exchange: Exchange) -> bool:
        """Take in an exchange; False if its readings cannot be, such as an answer before the question."""
        e = exchange
        took, held = e.heard - e.asked, e.answered - e.received
        if not (math.isfinite(took) and math.isfinite(held) and took >= 0.0 and held >= 0.0):
            return False
        rounding = 4.0 * math.ulp(max(abs(e.asked), abs(e.received), abs(e.answered), abs(e.heard)))
        slack = self._drift * took + rounding
        low, high = e.answered - e.heard - slack, e.received - e.asked + slack
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            return False
        self._kept.append((e.heard, low, high))
        while len(self._kept) > 1 and not self._agree(e.heard):
            self._kept.popleft()
            self.forgotten += 1
        return True

    def bounds(self, now: float) -> tuple[float, float] | None:
        """Between which values the offset is at `now` (asker's clock); None before the first exchange."""
        if not self._kept:
            return None
        low = max(low - self._drift * abs(now - heard) for heard, low, _ in self._kept)
        high = min(high + self._drift * abs(now - heard) for heard, _, high in self._kept)
        return low, high

    def _agree(self, now: float) -> bool:
        bounds = self.bounds(now)
        return bounds is not None and bounds[0] <= bounds[1]
