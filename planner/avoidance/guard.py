"""One robot's separation from the others, tick by tick: when to leave the planned way, and where to.

A Guard sees where its robot steers and what was last heard of the others, and says for what waypoint to steer
instead, if anything must be done. It asks the barrier whether the planned way may go on for a tick; only if
not, it looks for the motion nearest to it that may. Everybody gives way to the right, robots of higher id a
little sooner, so that two that meet head-on, or twenty on a ring, do not wait for each other.
"""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from planner.avoidance.barrier import allowed
from planner.avoidance.halt import Evader, Evasion
from planner.plan import VehicleModel

TICK_S = 0.1  # between decisions while out of the way
WATCH_S = 0.25  # between decisions while somebody is near
LATE_S = 0.05  # that a decision may come later
RESUME_S = 0.2  # for which the planned way must be allowed before it is taken again
KEEP = 0.15  # how much dearer another direction than the last is
STUCK = 0.1  # share of its speed below which a robot that is off its way is stuck
STUCK_S, TURN_S = 1.5, 1.5  # it backs off after this long, and this much later for each of higher id there
RETREAT_S, RETREAT_DEG = 4.0, 120.0  # so long, and so far to the right of its way
CALM_S = 0.5  # ticks go on this long after the last deviation
STALE_S = 1.5  # older poses are taken as this old: by then a robot without a link has halted
MARGIN_M = 0.3  # for ways compared at instants, and vehicles that move not quite as reckoned
SAMPLE_S = 0.1
SAMPLES = 160  # at most; ways that take longer are compared less often
ANGLES = (0.0, 20.0, -20.0, 40.0, -40.0, 65.0, -65.0, 90.0, -90.0, 115.0, -115.0, 150.0, -150.0, 180.0)
SHARES = (1.0, 0.5, 0.2)  # of the speed
TILTS = (0.0, 45.0, -45.0)
LEFT = 1.25  # how much dearer a way to the left is


@dataclass(frozen=True, slots=True)
class Sighting:
    """What was last heard of another robot."""

    time: float  # team time of its pose, s
    position: FloatArray  # (3,)
    velocity: FloatArray  # (3,)


@dataclass(frozen=True, slots=True)
class _Peer(Sighting):
    aim: FloatArray  # (3,) the velocity that it seems to steer for


class Guard:
    """Keeps one robot `separation` metres from the others. Mutable: remembers sightings and what it did."""

    def __init__(
        self, robot: str, models: Mapping[str, VehicleModel], separation: float, *, level: bool
    ) -> None:
        """`models` are the whole team's vehicles; `level`: it gives way to the sides only (2D)."""
        model = models[robot]
        self._model = model
        self._evader = model if isinstance(model, Evader) else None
        self._limits = {other: _limits(theirs) for other, theirs in sorted(models.items()) if other != robot}
        self._separation = separation
        self._level = level
        self._bias = 1.0 + 0.05 * (zlib.crc32(robot.encode()) % 16) / 16
        self._seen: dict[str, _Peer] = {}
        self._quiet_until = -math.inf
        self._calm_at = -math.inf
        self._next = math.inf
        self._last = -1  # of the choices, 0 to halt
        self._robot = robot
        self._neighbours: list[str] = []  # who could matter, as of the last decision
        self._stuck_since = -math.inf
        self._backing_until = -math.inf
        self._retreat = np.zeros(3)
        self._stop_at = np.zeros(3)
        self._gone: set[str] = set()
        self._cut_off = False  # nobody is heard any more, and somebody could be near
        self.diverted = False  # whether the robot is off its planned way

    def __repr__(self) -> str:
        return f"Guard(separation={self._separation}, diverted={self.diverted}, seen={sorted(self._seen)})"

    @property
    def next_wake(self) -> float:
        """The team time by which to decide again."""
        return self._next

    def gone(self, robot: str) -> None:
        """A robot left the team: it is not waited for, but stays an obstacle where it would have halted."""
        self._gone.add(robot)

    def idle(self, now: float) -> bool:
        """Whether nobody can be near yet: `decide` would do nothing."""
        return self._evader is None or self._separation <= 0 or now < self._quiet_until

    def see(self, robot: str, sighting: Sighting) -> None:
        """A robot's pose was heard. Sightings never end: who is silent is taken to be where it halted."""
        if robot not in self._limits or not (
            np.isfinite(sighting.position).all() and np.isfinite(sighting.velocity).all()
        ):
            return
        known = self._seen.get(robot)
        if (
            known is None
            or float(np.linalg.norm(known.position - sighting.position))
            > self._limits[robot].speed * max(sighting.time - known.time, 0.0) + self._separation
        ):
            self._quiet_until = -math.inf  # new, or started anew elsewhere
        aim = sighting.velocity
        if known is not None and self._limits[robot].lag > 0 and 0.01 < sighting.time - known.time < 0.5:
            # A velocity that changes follows an aim that is ahead of it by the lag.
            change = (sighting.velocity - known.velocity) / (sighting.time - known.time)
            strength = float(np.linalg.norm(change)) / self._limits[robot].acceleration
            aim = aim + change * (self._limits[robot].lag / max(strength, 1.0))
        self._gone.discard(robot)
        self._seen[robot] = _Peer(sighting.time, sighting.position, sighting.velocity, aim)

    def decide(self, now: float, state: FloatArray, waypoint: FloatArray) -> FloatArray | None:
        """For which waypoint (3,) to steer instead of `waypoint` (3,) until the next decision; None: go on.

        Args:
            now: team time, s; growing.
            state: the vehicle's full state.
        """
        if self._evader is None or self.idle(now):
            return None
        tick = (TICK_S if self.diverted or now < self._calm_at else WATCH_S) + LATE_S
        own = self._motion(state)
        near = self._near(now, own, tick)
        if self._cut_off:
            stop = self._halt(state, own)
            self.diverted, self._last, self._calm_at, self._next = True, 0, now + CALM_S, now + TICK_S
            return stop
        if not near:
            self.diverted = False
            return None
        others = np.stack([row for row, _, _ in near])
        ages = np.array([age for _, age, _ in near])
        apart = np.array([keep for _, _, keep in near])
        horizon = max(_settling(self._evader.evasion, own), *(_settling_row(row) for row in others))
        count = min(SAMPLES, int(horizon / SAMPLE_S) + 2)
        step = horizon / (count - 1)
        steps = max(1, round(tick / self._model.control_period))
        backs = self._backs_off(now, own, waypoint)
        if backs:
            waypoint = self._retreat
        begun = self._model.begin(state, waypoint) if self.diverted else state
        look = RESUME_S if self.diverted else tick  # not back before it lasts a while
        planned = self._after(begun, waypoint, max(1, round(look / self._model.control_period)))
        fine, _ = allowed(own, planned[None], others, ages, apart, look, step, count)
        if fine[0] and backs:
            self._last, self._calm_at, self._next = -1, now + CALM_S, now + TICK_S
            return waypoint
        if fine[0]:
            self.diverted, self._last = False, -1
            self._next = now + (TICK_S if now < self._calm_at else WATCH_S)
            return None
        ways, costs = self._choices(state, own, waypoint, others)
        asked = np.stack([self._after(self._model.begin(state, way), way, steps) for way in ways])
        fine, least = allowed(own, asked, others, ages, apart, tick, step, count)
        fine[0] = True  # halting is always allowed
        if self.diverted and self._last > 0:
            costs[self._last] -= KEEP
        costs = np.where(fine, costs, np.inf)
        if least[0] < self._separation + 0.5 * MARGIN_M:  # too near: who can come further away does
            costs = np.where(fine, -least, np.inf)
        self.diverted = True
        self._calm_at = now + CALM_S
        self._next = now + TICK_S
        self._last = int(np.argmin(costs))
        return ways[self._last]

    def _backs_off(self, now: float, own: FloatArray, waypoint: FloatArray) -> bool:
        """Whether it is time to make room for those with whom this robot waits: higher ids sooner."""
        assert self._evader is not None
        if now < self._backing_until:
            return True
        limits = self._evader.evasion
        moves = limits.turn_rate > 0 or float(np.linalg.norm(own[3:6])) > STUCK * limits.speed
        if not self.diverted or moves:
            self._stuck_since = now
            return False
        before = sum(robot > self._robot for robot in self._neighbours)
        if now - self._stuck_since < STUCK_S + TURN_S * before:
            return False
        gap = waypoint - own[:3]
        away = math.atan2(gap[1], gap[0]) - math.radians(RETREAT_DEG)
        length = 4.0 * self._separation + 2.0 * MARGIN_M
        self._retreat = own[:3] + length * np.array([math.cos(away), math.sin(away), 0.0])
        self._backing_until, self._stuck_since = now + RETREAT_S, now + RETREAT_S
        return True

    def _near(self, now: float, own: FloatArray, tick: float) -> list[tuple[FloatArray, float, float]]:
        """Motion, age and distance to keep, of all that could matter within the tick."""
        assert self._evader is not None
        speed = max(float(np.linalg.norm(own[3:6])), float(np.linalg.norm(own[6:9])))
        own_limits = self._evader.evasion
        reach = own_limits.reach(speed, tick)
        near = []
        self._neighbours = []
        quiet = math.inf
        self._cut_off = False
        awaited = [seen for robot, seen in self._seen.items() if robot not in self._gone]
        deaf = bool(awaited) and all(now - seen.time > STALE_S for seen in awaited)
        for robot, seen in self._seen.items():
            limits = self._limits[robot]
            age = min(max(now - seen.time, 0.0), STALE_S)
            theirs = max(float(np.linalg.norm(seen.velocity)), float(np.linalg.norm(seen.aim)))
            keep = self._separation + MARGIN_M + own_limits.margin + limits.margin
            keep += limits.uncertainty(theirs, age)
            gap = math.dist(own[:3], seen.position) - reach - limits.reach(theirs, age + tick) - keep
            if deaf and robot not in self._gone:
                # No link: the others do not hear this robot either, and may have gone anywhere meanwhile.
                gap -= limits.speed * (now - seen.time - STALE_S)
                self._cut_off = self._cut_off or gap <= 0
            if gap <= 0:
                self._neighbours.append(robot)
                near.append((limits.motion(seen.position, seen.velocity, seen.aim), age, keep))
            elif age >= STALE_S and robot in self._gone:
                quiet = min(quiet, gap / (3.0 * own_limits.speed))
            else:
                # Speeds, halts and uncertainties grow too: three times the speed bounds them all.
                quiet = min(quiet, gap / (3.0 * (own_limits.speed + limits.speed)))
        if near:
            self._quiet_until = -math.inf
            self._next = now + WATCH_S
        else:
            self._quiet_until = now + quiet
            self._next = math.inf if quiet == math.inf else now + max(quiet, WATCH_S)
        return near

    def _after(self, state: FloatArray, waypoint: FloatArray, steps: int) -> FloatArray:
        """The robot's motion after a tick of steering for a waypoint."""
        return self._motion(self._model.advance(state, waypoint, steps))

    def _motion(self, state: FloatArray) -> FloatArray:
        assert self._evader is not None
        position, velocity = self._model.pose(state)[:3], self._model.velocity(state)
        return self._evader.evasion.motion(position, velocity, self._evader.aim(state))

    def _halt(self, state: FloatArray, own: FloatArray) -> FloatArray:
        """The waypoint (3,) for which it brakes, or circles."""
        assert self._evader is not None
        if self._evader.evasion.turn_rate > 0:
            return self._model.pose(state)[:3]
        if not (self.diverted and self._last == 0):
            # Once: a waypoint set anew at every tick is braked for anew, each time a little later.
            self._stop_at = self._evader.steer(state, own[6:9])
        return self._stop_at

    def _choices(
        self, state: FloatArray, own: FloatArray, waypoint: FloatArray, others: FloatArray
    ) -> tuple[list[FloatArray], FloatArray]:
        """Waypoints to choose among, the first to halt, and how dear each is."""
        assert self._evader is not None
        limits = self._evader.evasion
        here = own[:3]
        circles = limits.turn_rate > 0
        ways, costs = [self._halt(state, own)], [3.0]
        gap = waypoint - here
        level = float(np.hypot(gap[0], gap[1]))
        speed = limits.speed if circles else min(limits.speed, limits.approach * float(np.linalg.norm(gap)))
        if level > 0.2:
            heading = math.atan2(gap[1], gap[0])
            pitch = 0.0 if self._level else math.atan2(gap[2], level)
        else:  # straight above or below, or there: away from the nearest is as good as anything
            nearest = others[np.argmin(np.linalg.norm(others[:, :3] - here, axis=1))]
            heading = math.atan2(here[1] - nearest[1], here[0] - nearest[0])
            pitch = 0.0 if self._level else math.copysign(0.5 * math.pi, gap[2]) * (abs(gap[2]) > 0.2)
            pitch *= 0.9
        speed = max(speed, 0.3 * limits.speed)
        for angle in ANGLES:
            for tilt in (0.0,) if self._level or abs(angle) > 90 else TILTS:
                climb = max(min(pitch + math.radians(tilt), 1.5), -1.5)
                turn = heading - math.radians(angle)  # positive is to the right
                flat = math.cos(climb)
                direction = np.array([math.cos(turn) * flat, math.sin(turn) * flat, math.sin(climb)])
                for share in (1.0,) if circles else SHARES:
                    ways.append(self._evader.steer(state, direction * (speed * share)))
                    off = abs(angle) / 90.0 * (1.0 if angle >= 0 else LEFT) + 0.9 * abs(tilt) / 90.0
                    costs.append(off * self._bias + 0.8 * (1.0 - share) + (2.0 if abs(angle) > 120 else 0.0))
        return ways, np.array(costs)


def _limits(model: VehicleModel) -> Evasion:
    """Of a model that does not say: it may stop at once, and its last velocity is all that is known."""
    return model.evasion if isinstance(model, Evader) else Evasion(10.0, 10.0)


def _settling(evasion: Evasion, own: FloatArray) -> float:
    return evasion.settling(float(np.linalg.norm(own[6:9]))) + 3.0 * evasion.lag


def _settling_row(row: FloatArray) -> float:
    if row[12] > 0:
        return 2.0 * math.pi / float(row[12])
    return Evasion(0.0, float(row[9]), float(row[10])).settling(float(np.linalg.norm(row[6:9])))
