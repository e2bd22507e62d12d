"""The one place in this room that reads a clock: how much wall time a planner has left.

Anytime planners ask between batches of their work and return the best that they have when it is over. What
they decide therefore depends on the machine as soon as a deadline is finite; tests and virtual time give
`PlanProblem.deadline_s` its default, infinity, and are the same on every machine.
"""

import math
import time
from collections.abc import Callable


class Deadline:
    """So many seconds from now.

    Args:
        seconds: may be infinite; zero or less is over at once.
        clock: seconds from anywhere, never going back.

    Raises:
        ValueError: if `seconds` is not a number.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.perf_counter) -> None:
        if math.isnan(seconds):
            raise ValueError("seconds: expected a number, infinity too, got nan")
        self.seconds = seconds
        self._clock = clock
        self._end = clock() + seconds

    def __repr__(self) -> str:
        return f"Deadline({self.seconds:g} s, {self.left():.3g} s left)"

    def left(self) -> float:
        """Seconds left, 0 when it is over."""
        return max(0.0, self._end - self._clock())

    def over(self) -> bool:
        """Whether nothing is left."""
        return self._clock() >= self._end
