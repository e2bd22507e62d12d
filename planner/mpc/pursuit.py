"""The target that one robot is after: which it is, how it moves, and where to look for it."""

import math
from dataclasses import dataclass, field

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel
from planner.irrt.targets import Targets
from planner.mpc.model import Domain, Limits
from planner.mpc.suspects import Suspects, careful_speed, places_of
from planner.plan import PlanProblem

JUMP_M = 5.0  # a target that moved further than this and its uncertainty is another
LONGEST_S = 10.0  # for which an old estimate is extrapolated
SAME_M = 1e-6  # an estimate that is this near to where it was extrapolated to is no news
SOON = 0.2  # share of the places where a target may come into view at the next step: the robot goes slowly
WIDE = 0.7  # of the width of what is seen at once: an estimate of greater standard deviation is searched for


@dataclass(slots=True)
class Pursuit:
    """What one robot remembers of its target."""

    velocity: FloatArray  # (2,) m/s
    time: float = math.nan  # of the newest estimate
    place: FloatArray = field(default_factory=lambda: np.zeros(2))  # then
    news: float = -math.inf  # when something was last learnt of it
    suspects: Suspects = field(default_factory=Suspects)

    def updated(
        self,
        problem: PlanProblem,
        targets: Targets,
        pose: FloatArray,
        gain: float,
        looks: tuple[FloatArray, FloatArray] | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Take in a problem; the target's place (2,) when the plan starts, and its covariance (2, 2).

        Args:
            problem: says of when the estimate is.
            targets: of the problem; at least one is known.
            pose: (4,) of the robot.
            gain: how much of a newly seen velocity is believed, where the filter has none.
            looks: times (m,) and poses (m, 4) at which the robot was to look since it was asked last.
        """
        index = self._followed(problem, targets, pose)
        place, spread = targets.means[:2, index], targets.covariances[index][:2, :2]
        believed = problem.intensity
        time = problem.start_time if believed is None or believed.time is None else believed.time
        self._learn(time, place, spread, targets.velocities[:2, index], gain)
        if looks is not None:
            done = (looks[0] > self.news) & (looks[0] < problem.start_time - SAME_M)
            self.suspects.looks.extend(zip(looks[0][done].tolist(), looks[1][done], strict=True))
        age = min(max(problem.start_time - time, 0.0), LONGEST_S)
        return place + age * self.velocity, spread

    def aim(
        self,
        problem: PlanProblem,
        sensor: SensorModel,
        domain: Domain,
        limits: Limits,
        place: FloatArray,
        spread: FloatArray,
        pose: FloatArray,
        seconds: tuple[float, float],
    ) -> tuple[FloatArray, float]:
        """Where the target is taken to be (2,), and how fast the robot may be; infinite: as it can.

        That is its place, unless the estimate is wider than what is seen at once; then it is searched for,
        and slowly where it may come into view. `seconds` are what is driven of a plan, and its horizon.
        """
        start, height, width = problem.start_time, float(pose[2]), domain.middle[1]
        spread = self.suspects.doubted(sensor, place, spread, self.velocity, start, height, width)
        if math.sqrt(max(float(np.linalg.eigvalsh(spread)[-1]), 0.0)) <= WIDE * width:
            self.suspects.chosen = -1
            return place, math.inf
        places = places_of(place, spread)
        missed = self.suspects.missed(sensor, places, self.velocity, start, height)
        low, high = problem.area.low[:2, None], problem.area.high[:2, None]
        missed *= ((places >= low) & (places <= high)).all(axis=0)
        aim = self.suspects.aim(
            places,
            missed,
            pose,
            width=width,
            reach=0.9 * domain.reach,
            half=0.8 * math.acos(max(domain.edge, -1.0)),
            speed=limits.fastest,
            turn_rate=limits.turn_rate,
            patience=0.2 * seconds[1],
        )
        near = np.hypot(*(places - pose[:2, None])) < domain.reach + limits.fastest * seconds[0]
        if missed[near].sum() < SOON * missed.sum():
            return aim, math.inf
        room = domain.reach - 0.5 * domain.middle[0]  # to stop half the standoff away
        careful = careful_speed(room, seconds[0], -limits.braking)
        return aim, careful + float(np.linalg.norm(self.velocity))

    def _followed(self, problem: PlanProblem, targets: Targets, pose: FloatArray) -> int:
        """Which of the known targets: that of before, else the nearest that no other robot is nearer to."""
        places = targets.means[:2, : targets.known]
        if not math.isnan(self.time):
            elapsed = max(0.0, min(problem.start_time - self.time, LONGEST_S))
            gaps = np.linalg.norm(places - (self.place + elapsed * self.velocity)[:, None], axis=0)
            spreads = np.sqrt(targets.covariances[: targets.known, :2, :2].trace(axis1=1, axis2=2))
            if (gaps < JUMP_M + 3.0 * spreads).any():
                return int(np.argmin(gaps))
        mine = np.linalg.norm(places - pose[:2, None], axis=0)
        ends = [other.poses[-1, :2] for other in problem.others if len(other.poses)]
        theirs = np.array([np.linalg.norm(places - end[:, None], axis=0) for end in ends])
        left = mine < theirs.min(axis=0) if ends else np.ones(mine.size, np.bool_)
        return int(np.argmin(np.where(left, mine, np.inf) if left.any() else mine))

    def _learn(
        self, time: float, place: FloatArray, spread: FloatArray, velocity: FloatArray, gain: float
    ) -> None:
        """Take in an estimate as of `time`: the velocity (5a), and whether it is news of the target."""
        flown = time - self.time
        jumped = np.linalg.norm(place - self.place) > JUMP_M + 3.0 * math.sqrt(float(np.trace(spread)))
        foretold = self.place + flown * velocity  # by a filter that had no news
        if velocity.any():
            self.velocity = velocity.copy()
        elif flown > 0 and not jumped:
            self.velocity = self.velocity + gain * ((place - self.place) / flown - self.velocity)
        if flown > 0 and not np.allclose(place, foretold, rtol=0.0, atol=SAME_M):
            self.suspects, self.news = Suspects(), time
        if not flown <= 0:  # also at first, when it is not a number
            self.time, self.place = time, place.copy()
