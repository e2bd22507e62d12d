"""What one robot knows of the team: the newest posterior, who looked where since, who goes where."""

from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np

from agents.wire.messages import (
    EstimateMessage,
    MeasurementSetMessage,
    PictureMessage,
    PlanMessage,
    PoseMessage,
)
from agents.wire.topics import POSTERIOR
from estimator.arrays import FloatArray
from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensor import SensorModel
from planner.plan import Commitment, Intensity

Look = tuple[float, str, FloatArray]  # time, robot, pose
_FOLD = 64


class Belief:
    """Grows by `hear`; everything it gives out is of the moment."""

    def __init__(
        self,
        robot: str,
        area: Area,
        grid: tuple[int, ...],
        sensors: Mapping[str, SensorModel],
        periods: Mapping[str, float],
    ) -> None:
        self.posterior: EstimateMessage | None = None
        self._estimates: dict[str, tuple[float, EstimateMessage]] = {}  # newest of each sender, when heard
        self.commitments: dict[str, Commitment] = {}
        self.poses: dict[str, PoseMessage] = {}
        self._robot = robot
        self._sensors = sensors
        self._periods = periods
        self._dimension = area.dimension
        self._base = Exploration.unexplored(area, grid)  # from the fusion's picture of _picture_time
        self._picture_time = -np.inf
        self._picture: PictureMessage | None = None
        self._looks: deque[Look] = deque()  # that the picture does not hold yet
        self._current: Exploration | None = None

    def __repr__(self) -> str:
        applied = self.posterior.applied if self.posterior else 0
        return f"Belief({self._robot}, applied={applied}, commitments={sorted(self.commitments)})"

    def hear_posterior(self, message: EstimateMessage, now: float = 0.0) -> None:
        """Believe the estimate that has most applied, of all fusions that are still heard.

        One of another dimension than the mission's is not believed at all.
        """
        if message.means.shape[0] != self._dimension:
            return
        _, known = self._estimates.get(message.sender, (now, None))
        if known is not None and known.boot == message.boot and known.sequence > message.sequence:
            return  # overtaken on its way
        self._estimates[message.sender] = now, message
        self._choose(now)

    def forget_posterior(self, sender: str, now: float) -> None:
        """A sender's estimate is not to be believed any more, if there is another."""
        self._estimates.pop(sender, None)
        self._choose(now)

    def _choose(self, now: float) -> None:
        oldest = now - POSTERIOR.stale_after_s
        heard = [message for when, message in self._estimates.values() if when >= oldest]
        if heard:
            self.posterior = max(heard, key=lambda message: (message.applied, message.time))

    def hear_picture(self, message: PictureMessage) -> None:
        """Take over the fusion's exploration function, unless its grid is another."""
        if message.time >= self._picture_time and message.exploration.shape == self._base.values.shape:
            values = message.exploration.astype(np.float64) / 255.0
            self._base = Exploration(values, self._base.low, self._base.high)
            self._picture_time = message.time
            self._picture = message
            self._looks = deque(look for look in self._looks if look[0] > message.time)
            self._current = None

    def hear_set(self, message: MeasurementSetMessage) -> None:
        """Remember where a robot looked, until the fusion's picture has it."""
        self.looked(message.time, message.sender, message.pose)

    def looked(self, time: float, robot: str, pose: FloatArray) -> None:
        """A robot measured at a time and pose (4,)."""
        if robot not in self._sensors:
            return
        self._looks.append((time, robot, pose))
        self._current = None
        if len(self._looks) > 2 * _FOLD:  # no picture for long: what is old enough is taken for good
            old = [self._looks.popleft() for _ in range(_FOLD)]
            self._base = self._explored_by(self._base, old)

    def hear_pose(self, message: PoseMessage) -> None:
        """Keep a robot's newest pose."""
        known = self.poses.get(message.sender)
        if known is None or known.boot != message.boot or message.time >= known.time:
            self.poses[message.sender] = message

    def hear_plan(self, message: PlanMessage) -> None:
        """Keep a robot's newest commitment."""
        known = self.commitments.get(message.sender)
        if known is not None and known.version > message.plan_version and known.boot == message.boot:
            return
        self.commitments[message.sender] = Commitment(
            robot=message.sender,
            boot=message.boot,
            version=message.plan_version,
            measure_times=message.measure_times,
            measure_poses=message.measure_poses,
            times=message.times,
            poses=message.poses,
            measure_period=self._periods.get(message.sender, 1.0),
        )

    def forget(self, robot: str) -> None:
        """A robot is gone: nothing of its plan is to be expected any more."""
        self.commitments.pop(robot, None)
        self.poses.pop(robot, None)

    def clusters(self) -> FloatArray:
        """Centres (d, c) of the estimated targets that are not yet found."""
        if self.posterior is None:
            return np.zeros((self._dimension, 0))
        return self.posterior.means

    def intensity(self, following: bool = False) -> Intensity | None:
        """What the newest posterior and picture say of targets; None before the first.

        Where found targets are followed they are among its clusters, each as one target.
        """
        p, picture = self.posterior, self._picture
        if p is None or picture is None:
            return None
        means, covariances, masses, velocities = p.means, p.covariances, p.masses, p.velocities
        if following and p.found.shape[1]:
            means = np.hstack([means, p.found])
            covariances = np.concatenate([covariances, p.found_covariances])
            masses = np.append(masses, np.ones(p.found.shape[1]))
            velocities = np.hstack([velocities, p.found_velocities])
        return Intensity(
            points=picture.points.astype(np.float64),
            weights=picture.weights.astype(np.float64),
            means=means,
            covariances=covariances,
            masses=masses,
            velocities=velocities,
            time=p.time,
        )

    def exploration(self) -> Exploration:
        """The exploration function as of the last look heard of, (MA)ASI (30)."""
        if self._current is None:
            self._current = self._explored_by(self._base, self._looks)
        return self._current

    def _explored_by(self, base: Exploration, looks: Iterable[Look]) -> Exploration:
        for time, robot, pose in looks:
            if time > self._picture_time:
                base = base.after(self._sensors[robot], pose[None, :])
        return base
