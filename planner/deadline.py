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

    The time is kept free for the step at the end of a plan, or the step is not begun without it. A slow time,
    of a kernel's first call or of a busy machine, is forgotten soon if the step was ever faster. Otherwise it
    is forgotten by and by, or it would forbid the step for ever.

    Args:
        seconds: that it may take, before it was ever measured.
        yields: whether the step itself looks at the clock, so that it is worth beginning with less.
        spread: how many times its usual time the step may take.
    """

    MARGIN = 1.2  # of what was measured
    YIELDS = 0.25  # of the whole time at most is kept for a step that yields
    SOON, SLOWLY = (
        0.7,
        0.97,
    )  # what is left of the reserve after a quicker time, and after it forbade the step
    RISING = 0.1  # how fast the usual time follows slower ones

    def __init__(self, seconds: float, *, yields: bool = False, spread: float = 3.0) -> None:
        self.seconds = seconds
        self._yields, self._spread = yields, spread
        self._usual = math.inf

    def __repr__(self) -> str:
        return f"Reserve({self.seconds:.3g} s)"

    def fits(self, deadline: Deadline) -> bool:
        """Whether there is time for the step."""
        if deadline.left() > self.kept(deadline):
            return True
        self.refused()
        return False

    def refused(self) -> None:
        """The step did not get its turn for want of time: a little less is kept for it from now on."""
        self.seconds = min(self.SLOWLY * self.seconds, self._spread * self._usual)

    def kept(self, deadline: Deadline) -> float:
        """Seconds of a deadline that are to be kept for the step."""
        return min(self.seconds, self.YIELDS * deadline.seconds) if self._yields else self.seconds

    @contextmanager
    def measured(self, deadline: Deadline) -> Iterator[None]:
        """Around the step."""
        before = deadline.passed()
        try:
            yield
        finally:
            self.took(deadline.passed() - before)

    @contextmanager
    def watched(self, deadline: Deadline) -> Iterator[Callable[[], bool]]:
        """Around a step that asks what is yielded whether time is up.

        Only the longest time for which it went on without asking counts as what it took.
        """
        asked, longest = deadline.passed(), 0.0

        def over() -> bool:
            nonlocal asked, longest
            now = deadline.passed()
            asked, longest = now, max(longest, now - asked)
            return deadline.over()

        try:
            yield over
        finally:
            over()
            self.took(longest)

    def took(self, seconds: float) -> None:
        """How long the step took."""
        slow = self.MARGIN * seconds
        self._usual = self._usual + self.RISING * (slow - self._usual) if slow > self._usual else slow
        self.seconds = max(self.SOON * self.seconds, slow)
