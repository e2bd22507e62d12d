"""Choosing one action for each of several robots: the planning modes of Dames & Kumar 2015, III-A1 to III-A3.

Robots at once: every joint action is looked at. Robots in turn: coordinate descent. The first plans on its
own, each following one given what those before it chose, and so on through the team until nobody changes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from estimator.arrays import FloatArray, IntArray
from planner.information.gains import Fixed, Options, information, nearest_first
from planner.information.mutual import Information, mutual_information

SAME = 1e-12  # nats: a change for less is none

Over = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Events:
    """What is decided: p_D (k, n), mu (k,)."""

    detection: FloatArray
    clutter: FloatArray

    def with_action(self, options: Options, index: int) -> "Events":
        """One more robot's action is decided."""
        return Events(
            np.vstack([self.detection, options.detection(index)]), np.append(self.clutter, options.clutter)
        )


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint action."""

    choice: tuple[int, ...]  # of each robot's options
    information: Information  # of the team, commitments included
    cycles: int  # through the team; 0: all joint actions were looked at


@dataclass(frozen=True, slots=True)
class Rules:
    """What information is computed of, and how exactly."""

    points: FloatArray  # (d, n)
    weights: FloatArray  # (n,)
    terms: int  # of the Taylor series
    limit: int  # events that are enumerated

    def of(self, events: Events) -> Information:
        """I[X; Y] of some events."""
        return mutual_information(events.detection, self.weights, events.clutter, self.terms, self.limit)

    def order(self, events: Events, at: FloatArray) -> IntArray:
        """Numbers of events (k,), that first whose expected detections are nearest to `at` (d,)."""
        return nearest_first(events.detection, self.points, self.weights, at)

    def fixed(self, events: Events, own: int, at: FloatArray) -> Fixed:
        """Of the decided events those nearest to `at` (d,), as many as leave room for `own` ones."""
        kept = np.sort(self.order(events, at)[: max(0, self.limit - own)])
        detection = np.ascontiguousarray(events.detection[kept])
        return Fixed.of(detection, self.weights, events.clutter[kept], self.terms)


def enumerated(team: list[Options], events: Events, rules: Rules, over: Over) -> Joint | None:
    """The best of all joint actions; of those looked at in time. None if time ran out before the first."""
    best, value = None, -np.inf
    none = Fixed.of(events.detection, rules.weights, events.clutter, rules.terms)
    bases: list[Fixed] = []
    last: tuple[int, ...] = ()
    for prefix in product(*(range(options.size) for options in team[:-1])):
        if best is not None and over():
            break
        same = next((k for k, (a, b) in enumerate(zip(prefix, last, strict=False)) if a != b), 0)
        del bases[same:]
        for r in range(len(bases), len(prefix)):
            bases.append((bases[-1] if bases else none).with_action(team[r], prefix[r]))
        last = prefix
        values = information(bases[-1] if bases else none, team[-1])
        index = int(np.argmax(values))
        if values[index] > value:
            best, value = (*prefix, index), float(values[index])
    if best is None:
        return None
    return Joint(best, rules.of(decided(team, best, events)), 0)


def in_turn(
    team: list[Options], events: Events, places: list[FloatArray], rules: Rules, cycles: int, over: Over
) -> Joint:
    """Coordinate descent to consensus, from nobody having an action; stops early when time runs out.

    Args:
        team: options of each robot, at least one each.
        events: what other robots have committed to.
        places: (d,) of each robot; of too many events the nearest count.
        rules: of information.
        cycles: through the team, at most.
        over: whether time has run out.
    """
    choice: list[int] = [-1] * len(team)
    done = 0
    for cycle in range(cycles):
        changed = False
        for r, options in enumerate(team):
            if over() and choice[r] >= 0:
                continue
            others = decided(team, [-1 if k == r else c for k, c in enumerate(choice)], events)
            values = information(rules.fixed(others, options.clutter.size, places[r]), options)
            best = int(np.argmax(values))
            if choice[r] < 0 or values[best] > values[choice[r]] + SAME:
                changed |= choice[r] != best
                choice[r] = best
        done = cycle + 1
        if not changed or over() or len(team) == 1:
            break
    chosen = tuple(choice)
    return Joint(chosen, rules.of(decided(team, chosen, events)), done)


def decided(team: list[Options], choice: tuple[int, ...] | list[int], events: Events) -> Events:
    """`events` and those of each robot's choice; a negative one is none."""
    for options, index in zip(team, choice, strict=True):
        if index >= 0:
            events = events.with_action(options, index)
    return events
