"""Which poses of others a robot need not look at: of those so far away that the next one will do.

In a team of fifty, fifty robots each hear 250 poses a second, and nearly all are of robots that could not
come near before they are heard again. What is passed over is as if it had been lost on the way, which the
receiver must bear anyway; it costs no decoding. Nobody is passed over for longer than `LONGEST_S`, so that
nobody counts as silent for it.
"""

import math
from collections.abc import Mapping

from estimator.arrays import FloatArray

LONGEST_S = 0.9  # team time; poses count as stale after 1.5 s and more
AHEAD_S = 4.0  # who could be within this of meeting is always heard


class Attention:
    """One robot's. Mutable: remembers until when each of the others may be passed over."""

    def __init__(self, robot: str, speeds: Mapping[str, float], separation: float) -> None:
        """`speeds`: at most, m/s, of each robot; who is not in it is always heard."""
        self._own = speeds.get(robot, math.inf)
        self._speeds = speeds
        self._separation = separation
        self._until: dict[str, float] = {}
        self.passed_over = 0

    def __repr__(self) -> str:
        return f"Attention(others={len(self._until)}, passed_over={self.passed_over})"

    def wants(self, sender: str, now: float) -> bool:
        """Whether to look at a pose of this robot at team time `now`."""
        if now < self._until.get(sender, -math.inf):
            self.passed_over += 1
            return False
        return True

    def heard(self, sender: str, theirs: FloatArray, mine: FloatArray, now: float) -> None:
        """A pose was looked at: where that robot and this one are, (3,) or longer, m."""
        closing = self._own + self._speeds.get(sender, math.inf)
        if not math.isfinite(closing) or closing <= 0.0:
            return
        gap = math.dist(theirs[:3], mine[:3]) - self._separation
        self._until[sender] = now + min(LONGEST_S, gap / closing - AHEAD_S)
