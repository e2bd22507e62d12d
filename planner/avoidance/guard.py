"""One robot's separation from the others, tick by tick: when to leave the planned way, and where to.

A Guard sees where its robot steers and what was last heard of the others, and says for what waypoint to steer
instead, if anything must be done. It lets the planned way go on as long as the barrier allows it and nobody
would be met soon; only then it looks for another motion: the cheapest that the barrier allows and that, with
its halt, keeps to the ground.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from planner.avoidance.barrier import allowed
from planner.avoidance.choices import SHARES, directions, fan, prices, soonest
from planner.avoidance.footing import Footing
from planner.avoidance.halt import Evader, Evasion, going_on, settling, steady
from planner.avoidance.neighbours import KEEP, Neighbours
from planner.plan import Ground, VehicleModel

TICK_S = 0.1  # between decisions while out of the way
WATCH_S = (1.5, 0.25)  # between decisions while somebody is near; the first for which the way is clear
LATE_S = 0.05  # that a decision may come later
RESUME_S = 0.2  # for which the planned way must be allowed before it is taken again
SWING_S, SWINGS = 4.0, 16  # until a vehicle is on its way back to the plan, and looks at that meanwhile
CALM_S = 0.5  # ticks go on this long after the last deviation
FORESIGHT_S = 2.0  # so much longer than a halt takes does a robot look ahead for whom it would meet
TRIES = 10  # motions that the barrier is asked about; all, of a robot that is stuck
KEEP_ON = 0.1  # how much cheaper the direction of the last way out is
STUCK = 0.1  # share of its speed below which a robot that is off its way is stuck
STUCK_S, TURN_S = 1.5, 1.5  # it backs off after this long, and this much later for each of higher id there
RETREAT_S, RETREAT_DEG = 4.0, 120.0  # so long, and so far to the right of its way


@dataclass(frozen=True, slots=True)
class _Near:
    """A robot's motion and those that could matter to it."""

    own: FloatArray  # (COLUMNS,)
    others: FloatArray  # (j, COLUMNS)
    ages: FloatArray  # (j,) s
    keeps: FloatArray  # (j,) metres to keep from each
    bases: FloatArray  # (j,) the same without what is uncertain

    def allows(self, after: FloatArray, tick: float) -> bool:
        """Whether the barrier allows a motion (COLUMNS,) that the robot would have after `tick` seconds."""
        own, others = self.own, self.others
        return bool(allowed(own, after[None], others, self.ages, self.keeps, self.bases, tick)[0][0])

    def close(self) -> BoolArray:
        """(j,) who stands in its way, rather than far off."""
        gaps = np.linalg.norm(self.others[:, :3] - self.own[:3], axis=1)
        return np.asarray(gaps < 2.0 * self.keeps)

    def met_after(self, velocity: FloatArray) -> float:
        """Seconds until it comes too near to anybody with a velocity (3,)."""
        return soonest(velocity, self.own, self.others, self.ages, self.keeps)


class Guard:
    """Keeps one robot `separation` metres from the others. Mutable: remembers sightings and what it did."""

    def __init__(
        self,
        robot: str,
        models: Mapping[str, VehicleModel],
        separation: float,
        *,
        level: bool,
        ground: Ground | None = None,
    ) -> None:
        """`models` are the whole team's vehicles; `level`: it gives way to the sides only (2D)."""
        model = models[robot]
        self._robot = robot
        self._model = model
        self._evader = model if isinstance(model, Evader) else None
        self._limits = _limits(model)
        self._separation = separation
        self._footing = Footing(ground, level=level)
        self._directions = directions(level=level)
        self._level = level
        self._shares = np.array((1.0,) if self._limits.turn_rate > 0 else SHARES)
        others = {other: _limits(theirs) for other, theirs in models.items() if other != robot}
        self._neighbours = Neighbours(self._limits, others, separation)
        self._next = -math.inf
        self._calm_at = -math.inf
        self._stuck_since = -math.inf
        self._backing_until = -math.inf
        self._retreat = np.zeros(3)
        self._heading = np.zeros(3)  # of the last way out
        self._halting = False
        self._stop_at = np.zeros(3)
        self.watching = False  # whether somebody is near enough to matter
        self.diverted = False  # whether the robot is off its planned way

    def __repr__(self) -> str:
        return f"Guard(separation={self._separation}, diverted={self.diverted}, {self._neighbours!r})"

    @property
    def next_wake(self) -> float:
        """The team time by which to decide again."""
        return self._next if self._evader is not None and self._separation > 0 else math.inf

    def park(self, starts: Mapping[str, Sequence[float]]) -> None:
        """Where others start (3,), m: until more is known of them, they are obstacles there."""
        self._neighbours.park(starts)
        self._next = -math.inf

    def expect(self, robot: str) -> None:
        """A robot came. If it was never heard, it left its start at team time 0 for nobody knows where."""
        if self._neighbours.expect(robot):
            self._next = -math.inf

    def gone(self, robot: str) -> None:
        """A robot left the team: it is not waited for, but stays an obstacle where it would have halted."""
        self._neighbours.leave(robot)

    def see(
        self,
        robot: str,
        time: float,
        position: Sequence[float],
        velocity: Sequence[float],
        delay: float = 0.0,
    ) -> None:
        """A robot's pose (3,), m, and velocity (3,), m/s, of a team time were heard, `delay` seconds later.

        Sightings never end: who is silent is taken to be where it halted.
        """
        if self._neighbours.see(robot, time, position, velocity, delay):
            self._next = -math.inf

    def decide(self, now: float, state: FloatArray, waypoint: FloatArray) -> FloatArray | None:
        """For which waypoint (3,) to steer instead of `waypoint` (3,) until `next_wake`; None: go on.

        Args:
            now: team time, s; growing.
            state: the vehicle's full state.
        """
        if self._evader is None or self._separation <= 0:
            return None
        own = self._motion(state)
        rows, ages, keeps, quiet, cut_off = self._neighbours.near(now, own, WATCH_S[0] + LATE_S)
        self.watching = cut_off or rows.size > 0
        if cut_off:
            return self._turned(now, self._halt(state, own))
        if not self.watching and (not self.diverted or self._footing.open):
            self.diverted, self._halting = False, False
            self._next = now + max(quiet, WATCH_S[0])
            return None
        near = _Near(own, self._neighbours.motions[rows], ages, keeps, self._neighbours.limits[rows, KEEP])
        backs = self._backs_off(now, own, waypoint, rows[near.close()])
        goal = self._retreat if backs else self._footing.toward(now, own[:3], waypoint, self.diverted)
        begun = self._model.begin(state, goal) if self.diverted else state
        calm = not self.diverted and now >= self._calm_at
        for wait in WATCH_S if calm else (TICK_S,):
            look = RESUME_S if self.diverted else wait + LATE_S  # not back before it lasts a while
            if steady(own, goal, self._limits.speed, look):
                planned = going_on(own, look)
            else:
                planned = self._after(begun, goal, look)
            ahead = settling(planned) + FORESIGHT_S
            # One that has still to turn, or to speed up, would not meet anybody: where it will go counts.
            going = self._wanted(own, goal) if self.diverted else planned[6:9]
            if not near.allows(planned, look) or near.met_after(going) < ahead:
                continue
            if self.diverted and not self._leads_back(own, begun, goal, planned):
                continue
            if goal is not waypoint:
                self._halting = False
                return self._turned(now, goal)
            self.diverted, self._halting = False, False
            self._next = now + wait
            return None
        return self._turned(now, self._aside(now, state, near, goal, ahead))

    def _leads_back(self, own: FloatArray, state: FloatArray, goal: FloatArray, soon: FloatArray) -> bool:
        """Whether the ground is clear on the way back to the plan, however wide the vehicle swings."""
        if self._footing.open:
            return True
        places, steps = [own[:3]], max(1, round(SWING_S / SWINGS / self._model.control_period))
        for _ in range(SWINGS):
            state = self._model.advance(state, goal, steps)
            places.append(self._model.pose(state)[:3])
        return self._footing.holds(own[:3], soon) and self._footing.along(np.array(places))

    def _aside(
        self, now: float, state: FloatArray, near: "_Near", goal: FloatArray, ahead: float
    ) -> FloatArray:
        """The cheapest waypoint (3,) that may be steered for for a tick; to halt if there is none."""
        assert self._evader is not None
        own, speed, tick = near.own, self._limits.speed, TICK_S + LATE_S
        wanted = self._wanted(own, goal)
        fastest = max(float(np.linalg.norm(wanted)), 0.3 * speed)
        velocities = fan(self._directions, wanted, fastest, self._shares)
        cost = prices(velocities, wanted, speed, own, near.others, near.ages, near.keeps, ahead)
        if self.diverted:
            cost -= (
                KEEP_ON * (velocities @ self._heading) / np.maximum(np.linalg.norm(velocities, axis=1), 1e-9)
            )
        tries = TRIES if now - self._stuck_since < STUCK_S else cost.size
        for i in np.argsort(cost, kind="stable")[:tries]:
            way = self._evader.steer(state, velocities[i])
            after = self._after(self._model.begin(state, way), way, tick)
            if self._limits.swerving > 0 and not near.allows(self._turned_to(own, velocities[i]), tick):
                continue  # turning on the spot is always allowed, but of no use
            if near.allows(after, tick) and self._footing.holds(own[:3], after):
                self._halting = False
                self._heading = velocities[i] / max(float(np.linalg.norm(velocities[i])), 1e-9)
                return way
        return self._halt(state, own)

    def _turned_to(self, own: FloatArray, velocity: FloatArray) -> FloatArray:
        """The motion (COLUMNS,) at a velocity (3,) that it has turned to, a step further."""
        return self._limits.motion(own[:3] + velocity * TICK_S, velocity, velocity)

    def _turned(self, now: float, way: FloatArray) -> FloatArray:
        self.diverted = True
        self._calm_at = now + CALM_S
        self._next = now + TICK_S
        return way

    def _wanted(self, own: FloatArray, waypoint: FloatArray) -> FloatArray:
        """The velocity (3,) m/s with which it would go to a waypoint (3,) if it were alone."""
        limits = self._limits
        gap = waypoint - own[:3]
        if self._level:
            gap[2] = 0.0
        distance = float(np.linalg.norm(gap))
        if limits.turn_rate > 0:
            speed = limits.speed
        else:
            braking = math.sqrt(2.0 * limits.acceleration * distance)
            speed = min(limits.speed, limits.approach * distance, braking)
        return gap * (speed / max(distance, 1e-9))

    def _backs_off(self, now: float, own: FloatArray, waypoint: FloatArray, rows: IntArray) -> bool:
        """Whether it is time to make room for those with whom this robot waits: higher ids sooner."""
        limits = self._limits
        moves = limits.turn_rate > 0 or float(np.linalg.norm(own[3:6])) > STUCK * limits.speed
        if not self.diverted or moves:
            self._stuck_since = now
        if now < self._backing_until:
            return True
        if not self.diverted or moves:
            return False
        before = sum(self._neighbours.names[row] > self._robot for row in rows)
        if now - self._stuck_since < STUCK_S + TURN_S * before:
            return False
        gap = waypoint - own[:3]
        away = math.atan2(gap[1], gap[0]) - math.radians(RETREAT_DEG)
        length = 4.0 * self._separation
        self._retreat = own[:3] + length * np.array([math.cos(away), math.sin(away), 0.0])
        self._backing_until = now + RETREAT_S
        return True

    def _after(self, state: FloatArray, waypoint: FloatArray, seconds: float) -> FloatArray:
        """The robot's motion after so long of steering for a waypoint."""
        steps = max(1, round(seconds / self._model.control_period))
        return self._motion(self._model.advance(state, waypoint, steps))

    def _motion(self, state: FloatArray) -> FloatArray:
        assert self._evader is not None
        position, velocity = self._model.pose(state)[:3], self._model.velocity(state)
        return self._limits.motion(position, velocity, self._evader.aim(state))

    def _halt(self, state: FloatArray, own: FloatArray) -> FloatArray:
        """The waypoint (3,) for which it brakes, or circles."""
        assert self._evader is not None
        if self._limits.turn_rate > 0:
            return self._model.pose(state)[:3]
        if not self._halting:
            # Once: a waypoint set anew at every tick is braked for anew, each time a little later.
            self._halting = True
            self._stop_at = self._evader.steer(state, own[6:9])
        return self._stop_at


def _limits(model: VehicleModel) -> Evasion:
    """Of a model that does not say: it may stop at once, and its last velocity is all that is known."""
    evasion = getattr(model, "evasion", None)  # asked of a thousand models, where isinstance takes its time
    return evasion if isinstance(evasion, Evasion) else Evasion(10.0, 10.0)
