"""Who of the others could matter to a robot within a tick, and for how long nobody can."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.kernels import exact_kernel
from planner.avoidance.halt import COLUMNS, Evasion, stopping

STALE_S = 1.5  # after so long without any news a robot halts; of who is silent for longer that is expected
# Of a robot's limits: speed, deceleration, approach, lag, turn rate, agility, climb, metres to keep from it.
SPEED, DECELERATION, APPROACH, LAG, TURN, AGILITY, CLIMB, KEEP, LIMITS = range(9)
HALF_TURN = 0.5  # a change of velocity lasts while it brakes, and by half on average
TURNED_S = 0.5  # at most so much of both ways' delay is counted for that
SWERVE = 0.2  # share of its way since its last pose by which a guessed aim may be wrong


class Neighbours:
    """What was last heard of the others. Mutable, in arrays: sightings come often and must cost little."""

    def __init__(self, own: Evasion, others: Mapping[str, Evasion], separation: float) -> None:
        """`separation` metres are to be kept, beside what the vehicles' own margins ask for."""
        self._rows = {robot: row for row, robot in enumerate(sorted(others))}
        count = len(others)
        self.own = limits(own, separation)
        self.limits = np.zeros((count, LIMITS))
        for robot, row in self._rows.items():
            self.limits[row] = limits(others[robot], separation + own.margin + others[robot].margin)
        self.names = sorted(others)
        self.motions = np.zeros((count, COLUMNS))
        self.motions[:, 9:] = self.limits[:, DECELERATION : TURN + 1]
        self.heard = np.full(count, -np.inf)  # of when the newest pose is
        self.delays = np.zeros(count)  # how old it was when it came
        self.gone = np.zeros(count, dtype=np.bool_)
        self.supposed = np.zeros(count, dtype=np.bool_)  # never heard, but where it starts is known

    def __repr__(self) -> str:
        seen = [robot for robot, row in self._rows.items() if self.heard[row] > -np.inf]
        return f"Neighbours(seen={seen})"

    def park(self, starts: Mapping[str, Sequence[float]]) -> None:
        """Robots of which nothing is known stand at their starts (3,), as obstacles that nobody waits for."""
        for robot, row in self._rows.items():
            if robot in starts and self.heard[row] == -np.inf:
                self.motions[row, :3] = starts[robot]
                self.heard[row], self.gone[row], self.supposed[row] = 0.0, True, True

    def expect(self, robot: str) -> bool:
        """A robot is there; whether all that is known of it is that it stood at its start at team time 0."""
        row = self._rows.get(robot)
        supposed = row is not None and bool(self.supposed[row])
        if supposed:
            self.gone[row] = False
        return supposed

    def leave(self, robot: str) -> None:
        """It is not waited for any more, but stays an obstacle where it would have halted."""
        if robot in self._rows:
            self.gone[self._rows[robot]] = True

    def see(
        self,
        robot: str,
        time: float,
        position: Sequence[float],
        velocity: Sequence[float],
        delay: float = 0.0,
    ) -> bool:
        """A robot's pose was heard; whether it comes as a surprise: it is new, or not where it could be.

        It is of `time`, and came `delay` seconds later.

        Poses that are older than what is known, of strangers, or not finite are not believed.
        """
        row = self._rows.get(robot)
        x, y, z = position
        vx, vy, vz = velocity
        if row is None or not math.isfinite(x + y + z + vx + vy + vz):
            return False
        motion = self.motions[row]
        px, py, pz, ux, uy, uz = motion[:6].tolist()
        since = time - float(self.heard[row])
        if since <= 0 and not self.supposed[row]:
            return False
        speed, acceleration, _, lag, *_, keep = self.limits[row].tolist()
        surprise = bool(math.hypot(x - px, y - py, z - pz) > speed * since + keep) or since == math.inf
        ax, ay, az = vx, vy, vz
        if lag > 0 and 0.01 < since < 0.5 and not surprise:
            # A velocity that changes follows an aim that is ahead of it by the lag.
            dx, dy, dz = (vx - ux) / since, (vy - uy) / since, (vz - uz) / since
            strength = math.hypot(dx, dy, dz) / acceleration
            ahead = lag / max(strength, 1.0)
            ax, ay, az = vx + dx * ahead, vy + dy * ahead, vz + dz * ahead
        motion[:9] = (x, y, z, vx, vy, vz, ax, ay, az)
        self.heard[row] = time
        self.delays[row] = max(delay, 0.0) if math.isfinite(delay) else 0.0
        self.gone[row] = self.supposed[row] = False
        return surprise

    def near(
        self, now: float, own: FloatArray, tick: float
    ) -> tuple[IntArray, FloatArray, FloatArray, float, bool]:
        """Rows, ages in seconds and metres to keep, of all that could matter within the tick.

        Also for how many seconds nobody can matter if nobody does, and whether the robot seems to be without
        a link while somebody could be near.
        """
        return _near(now, own, self.own, tick, self.motions, self.heard, self.delays, self.gone, self.limits)


def limits(evasion: Evasion, keep: float) -> FloatArray:
    """The row (LIMITS,) for the kernels."""
    e = evasion
    return np.array([e.speed, e.acceleration, e.approach, e.lag, e.turn_rate, e.agility, e.climb, keep])


@exact_kernel
def _near(
    now: float,
    own: FloatArray,
    own_limits: FloatArray,
    tick: float,
    motions: FloatArray,
    heard: FloatArray,
    delays: FloatArray,
    gone: BoolArray,
    limits: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray, float, bool]:
    count = heard.size
    rows, ages, keeps = np.empty(count, dtype=np.int64), np.empty(count), np.empty(count)
    awaited, deaf = False, True
    for q in range(count):
        if heard[q] > -np.inf and not gone[q]:
            awaited = True
            deaf = deaf and now - heard[q] - delays[q] > STALE_S
    deaf = deaf and awaited
    reach = _reach(own_limits, _fastest(own), tick)
    found, quiet, cut_off = 0, np.inf, False
    for q in range(count):
        if heard[q] == -np.inf:
            continue
        # Late news are news: whoever they come from flies on, and may be elsewhere the later they are. Who is
        # silent has heard nothing either by the time at which the next news would have been so late.
        halts_at = delays[q] + STALE_S
        age = min(max(now - heard[q], 0.0), halts_at)
        speed = _fastest(motions[q])
        keep = limits[q, KEEP] + _uncertainty(limits[q], speed, age, delays[q])
        square = 0.0
        for axis in range(3):
            square += (own[axis] - motions[q, axis]) ** 2
        gap = math.sqrt(square) - reach - _reach(limits[q], speed, age + tick) - keep
        if deaf and not gone[q]:
            # No link: the others do not hear this robot either, and may have gone anywhere meanwhile.
            gap -= limits[q, SPEED] * (now - heard[q] - halts_at)
            cut_off = cut_off or gap <= 0
        if gap <= 0:
            rows[found], ages[found], keeps[found] = q, age, keep
            found += 1
        else:
            # Speeds, halts and uncertainties grow too: this bounds them all.
            closing = 3.0 * own_limits[SPEED]
            if not (gone[q] and age >= halts_at):
                bends = min(halts_at * limits[q, AGILITY], 4.0 * limits[q, SPEED])
                closing += 3.0 * limits[q, SPEED] + max(bends, STALE_S * limits[q, AGILITY])
            quiet = min(quiet, gap / closing)
    return rows[:found], ages[:found], keeps[:found], quiet, cut_off


@exact_kernel
def _fastest(motion: FloatArray) -> float:
    now = motion[3] * motion[3] + motion[4] * motion[4] + motion[5] * motion[5]
    aim = motion[6] * motion[6] + motion[7] * motion[7] + motion[8] * motion[8]
    return math.sqrt(max(now, aim))


@exact_kernel
def _reach(limits: FloatArray, speed: float, seconds: float) -> float:
    """Metres from here of whatever it can come to in so many seconds and then halting."""
    if limits[TURN] > 0.0:
        return float(speed * seconds + 2.0 * speed / limits[TURN])
    fast = min(limits[SPEED], speed + limits[AGILITY] * seconds)
    halt = stopping(fast, limits[DECELERATION], limits[APPROACH])
    return float(fast * (seconds + limits[LAG]) + halt)


@exact_kernel
def _uncertainty(limits: FloatArray, speed: float, age: float, delay: float) -> float:
    """Metres by which it may be elsewhere than where halting or going on would have brought it."""
    bent = min(0.5 * limits[AGILITY] * age * age, 2.0 * limits[SPEED] * age)
    guessed = SWERVE * speed * age if limits[LAG] > 0.0 else 0.0
    # News that are late let both turn before either knows of it. Where one would halt moves further than it
    # does itself: its new velocity lasts while it brakes.
    late = min(2.0 * delay, TURNED_S)
    turned = HALF_TURN * limits[AGILITY] * late * speed / limits[DECELERATION]
    return float(bent + guessed + turned + limits[CLIMB] * age)
