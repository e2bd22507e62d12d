"""The one place in this room that reads a clock: how much wall time a planner has left.

Anytime planners ask between batches of their work and return the best that they have when it is over. What
they decide therefore depends on the machine as soon as a deadline is finite; tests and virtual time give
`PlanProblem.deadline_s` its default, infinity, and are the same on every machine.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


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
        self._begun = clock()
        self._end = self._begun + seconds

    def __repr__(self) -> str:
        return f"Deadline({self.seconds:g} s, {self.left():.3g} s left)"

    def left(self) -> float:
        """Seconds left, 0 when it is over."""
        return max(0.0, self._end - self._clock())

    def over(self) -> bool:
        """Whether nothing is left."""
        return self._clock() >= self._end

    def passed(self) -> float:
        """Seconds since it was set."""
        return self._clock() - self._begun

    def less(self, seconds: float) -> "Deadline":
        """One that is over so many seconds sooner."""
        sooner = Deadline(self.seconds - seconds, self._clock)
        sooner._begun, sooner._end = self._begun, self._end - seconds
        return sooner


class Reserve:
    """What one step of a planner takes that cannot be interrupted, as measured when it was done before.

    The time is kept free for the step at the end of a plan, or the step is not begun without it. What was
    measured is forgotten by and by, or one slow time would forbid the step for ever.

    Args:
        seconds: that it may take, before it was ever measured.
    """

    MARGIN = 1.2  # of what was measured last
    FORGOTTEN = 0.9  # is left of the reserve after each plan

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def __repr__(self) -> str:
        return f"Reserve({self.seconds:.3g} s)"

    def fits(self, deadline: Deadline) -> bool:
        """Whether there is time for the step."""
        if deadline.left() > self.seconds:
            return True
        self.seconds *= self.FORGOTTEN
        return False

    @contextmanager
    def measured(self, deadline: Deadline) -> Iterator[None]:
        """Around the step."""
        before = deadline.passed()
        try:
            yield
        finally:
            took = deadline.passed() - before
            self.seconds = max(self.FORGOTTEN * self.seconds, self.MARGIN * took)
