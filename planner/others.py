"""The other robots as one plan sees them, looked at once and not anew for every candidate."""

from collections.abc import Sequence

from planner.commitments import Looks, heeded, looks
from planner.plan import Commitment, PlanProblem
from planner.separation import Courses


class Others:
    """Those of some commitments that a robot can plan around, with what was worked out of them so far."""

    def __init__(self, commitments: Sequence[Commitment], problem: PlanProblem) -> None:
        self.commitments = heeded(commitments, problem.robot)
        self._start = problem.start_time
        self._courses: Courses | None = None
        self._tails: dict[int, Looks] = {}

    def __repr__(self) -> str:
        return f"Others({', '.join(other.robot for other in self.commitments)})"

    @property
    def courses(self) -> Courses:
        """Their ways."""
        if self._courses is None:
            self._courses = Courses.of(self.commitments)
        return self._courses

    def tail(self, i: int) -> Looks:
        """When and from where number i will measure from the plan's start on."""
        if i not in self._tails:
            self._tails[i] = looks(self.commitments[i], self._start)
        return self._tails[i]
