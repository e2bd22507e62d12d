"""A robot's measure clock: absolute deadlines a period apart, begun anew at every waypoint."""

import numpy as np

from agents.machine import Measure
from agents.mission.mission import TriggerTable
from agents.robot.belief import Belief
from estimator.arrays import FloatArray
from estimator.sensor import SensorModel
from planner.maasi.trigger import worth_measuring


class MeasureClock:
    """Says when to measure. `at` is the next deadline in team time."""

    def __init__(
        self, sensor: SensorModel, period: float, trigger: TriggerTable, start: float, own_times: bool
    ) -> None:
        """`own_times`: the device says when it has its next set, and the first is at `start`."""
        self.at = start
        self.skipped = 0  # not worth taking
        self.untimed = 0  # not taken, because nobody could say when
        self.trusted = True  # whether the robot's clock is the team's
        self._sensor = sensor
        self._period = period
        self._trigger = trigger
        self._own_times = own_times
        self._imposed = True  # the next measurement is at a waypoint and is always taken

    def __repr__(self) -> str:
        return f"MeasureClock(at={self.at:.3f}, skipped={self.skipped}, untimed={self.untimed})"

    def waypoint(self, time: float) -> None:
        """A way begins at this time: it is begun with a measurement."""
        if not self._own_times:
            self.at, self._imposed = time, True

    def next_set(self, time: float | None) -> None:
        """When the device will have its next set, if it says so."""
        if time is not None:
            self.at = time

    def measure(self, now: float, pose: FloatArray, belief: Belief) -> list[Measure]:
        """What to do at `now`, with the deadline reached and the robot at pose (4,)."""
        deadline = self.at
        if now < deadline:
            return []
        if self._own_times:
            self.at = np.inf  # until the device says
            return [Measure(deadline)]
        missed = max(0, int((now - deadline) / self._period))
        self.at = deadline + (missed + 1) * self._period
        imposed, self._imposed = self._imposed, False
        if not self.trusted:
            self.untimed += 1
            return []
        if self._trigger.enabled and not imposed:
            clusters, exploration = belief.clusters(), belief.exploration()
            gamma, threshold = self._trigger.gamma, self._trigger.threshold
            if not worth_measuring(self._sensor, clusters, exploration, pose, gamma, threshold):
                self.skipped += 1
                return []
        return [Measure(deadline)]
