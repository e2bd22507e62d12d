"""Choosing one action for each of several robots: the planning modes of Dames & Kumar 2015, III-A1 to III-A3.

Robots at once: every joint action is looked at. Robots in turn: coordinate descent. The first plans on its
own, each following one given what those before it chose, and so on through the team until nobody changes.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from estimator.arrays import FloatArray
from planner.information.events import Events, nearest
from planner.information.gains import Fixed, Options, information
from planner.information.mutual import Information, mutual_information
from planner.plan import Over

SAME = 1e-12  # nats: a change for less is none
NOTHING = Information(0.0, 0.0, True)
AT_ONCE = 1 << 12  # outcomes, of all actions, that are worked out between questions for the time


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint action."""

    choice: tuple[int, ...]  # of each robot's options
    information: Information  # of the team, commitments included
    cycles: int  # through the team; 0: all joint actions were looked at
    views: "tuple[View | None, ...]"  # each robot's latest, where there is one


@dataclass(frozen=True, slots=True)
class View:
    """What one robot's options are worth while the others keep to theirs."""

    others: tuple[int, ...]  # the choice of all robots; its own does not count
    values: FloatArray  # (a,) nats of the team; -inf: not looked at
    without: float  # nats of the team without this robot
    neglected: float  # nats that events too many to count may add to the values
    error: float  # by which the Taylor terms of the others' events may mistake them


@dataclass(frozen=True, slots=True)
class Rules:
    """What information is computed of, and how exactly."""

    points: FloatArray  # (d, n)
    weights: FloatArray  # (n,)
    terms: int  # of the Taylor series
    limit: int  # events that are enumerated

    def view(
        self,
        team: list[Options],
        choice: list[int] | tuple[int, ...],
        robot: int,
        events: Events,
        at: FloatArray,
        over: Over,
    ) -> View:
        """Robot number `robot`'s options given the others' choice; of too many events the nearest to `at`."""
        options = team[robot]
        others = decided(team, [-1 if r == robot else c for r, c in enumerate(choice)], events)
        room = max(0, self.limit - options.clutter.size)
        fixed, neglected = nearest(others, self.points, self.weights, at, room, self.terms)
        values = in_pieces(fixed, options, over)
        return View(tuple(choice), values, fixed.information, neglected, fixed.error)

    def told(self, view: View, options: Options, index: int) -> Information:
        """The team's information with one robot's option: no less than what counts, no more than all says."""
        half = 0.5 * view.neglected
        error = half + view.error + float(options.error[index])
        return Information(float(view.values[index]) + half, error, view.neglected == 0.0)

    def of(self, events: Events) -> Information:
        """I[X; Y] of some events, of too many by the bounds of `mutual`."""
        return mutual_information(events.detection, self.weights, events.clutter, self.terms, self.limit)


def in_pieces(fixed: Fixed, options: Options, over: Over) -> FloatArray:
    """`gains.information` of as many options as there is time for; -inf of the others."""
    values = np.full(options.size, -np.inf)
    step = max(1, AT_ONCE >> (fixed.clutter.size + options.clutter.size))
    for first in range(0, options.size, step):
        if first and over():
            break
        last = min(first + step, options.size)
        values[first:last] = information(fixed, options, first, last)
    return values


def enumerated(team: list[Options], events: Events, rules: Rules, over: Over) -> Joint | None:
    """The best of all joint actions; of those looked at in time. None if time ran out before the first."""
    best: tuple[int, ...] | None = None
    value, error = -np.inf, 0.0
    bases = [Fixed.of(events.detection, rules.weights, events.clutter, rules.terms)]
    last: tuple[int, ...] = ()
    for prefix in product(*(range(options.size) for options in team[:-1])):
        if best is not None and over():
            break
        same = next((k for k, (a, b) in enumerate(zip(prefix, last, strict=False)) if a != b), 0)
        del bases[same + 1 :]
        for r in range(len(bases) - 1, len(prefix)):
            bases.append(bases[-1].with_action(team[r], prefix[r]))
        last = prefix
        values = in_pieces(bases[-1], team[-1], over)
        index = int(np.argmax(values))
        if values[index] > value:
            best, value = (*prefix, index), float(values[index])
            error = bases[-1].error + float(team[-1].error[index])
    if best is None:
        return None
    return Joint(best, Information(value, error, True), 0, (None,) * len(team))


def in_turn(
    team: list[Options],
    events: Events,
    places: list[FloatArray],
    rules: Rules,
    cycles: int,
    over: Over,
) -> Joint:
    """Coordinate descent to consensus, from nobody having an action; stops early when time runs out.

    Robots that had no turn by then have no action, and the choice of them is -1.

    Args:
        team: options of each robot, at least one each.
        events: what other robots have committed to.
        places: (d,) of each robot; of too many events the nearest count.
        rules: of information.
        cycles: through the team, at most.
        over: whether time has run out.
    """
    choice: list[int] = [-1] * len(team)
    views: list[View | None] = [None] * len(team)
    told, done, late = NOTHING, 0, False
    for cycle in range(cycles):
        changed = False
        for r in range(len(team)):
            known = views[r]
            if late or (known is not None and same_others(known.others, choice, r)):
                continue  # nothing new to choose by
            if over():
                late = True
                continue
            views[r] = view = rules.view(team, choice, r, events, places[r], over)
            best = int(np.argmax(view.values))
            if choice[r] < 0 or view.values[best] > view.values[choice[r]] + SAME:
                changed |= choice[r] != best
                choice[r] = best
            told = rules.told(view, team[r], choice[r])
        done = cycle + 1
        if not changed or late or len(team) == 1:
            break
    return Joint(tuple(choice), told, done, tuple(views))


def same_others(before: tuple[int, ...], now: list[int] | tuple[int, ...], robot: int) -> bool:
    """Whether two choices differ in one robot's only."""
    return all(a == b for r, (a, b) in enumerate(zip(before, now, strict=True)) if r != robot)


def decided(team: list[Options], choice: tuple[int, ...] | list[int], events: Events) -> Events:
    """`events` and those of each robot's choice; a negative one is none."""
    some = [(options, index) for options, index in zip(team, choice, strict=True) if index >= 0]
    if not some:
        return events
    points = events.detection.shape[1]
    rows = [options.detection(index, points) for options, index in some]
    rates = [options.clutter for options, _ in some]
    return Events(np.vstack([events.detection, *rows]), np.concatenate([events.clutter, *rates]))
