"""Operators' statements: from a mission's or a command's table to a message, a model, and words."""

from math import degrees, radians
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from agents.mission.mission import StatementTable
from agents.wire.codec import POINTS
from agents.wire.messages import Array, Relation, SoftObservationMessage

if TYPE_CHECKING:
    from estimator.soft.statement import SoftObservation

_NAMES = {"far": "far from", "in_front": "in front of", "left": "left of", "right": "right of"}
_SPELT_OUT = 4  # corners of a region that are named one by one


class Said(TypedDict):
    """The fields of a soft observation without its header."""

    relation: Relation
    points: Array
    yaw: float
    inner: float
    outer: float
    slope: float
    positive: bool
    target: str


def said(table: StatementTable) -> Said:
    """What a table states.

    Raises:
        ValueError: if a key does not fit the relation; names it.
    """
    fewest, most = POINTS[table.relation]
    if not fewest <= len(table.at) <= most:
        raise ValueError(f"at: found {len(table.at)} places, allowed are {_places(fewest, most)}")
    inner, outer = 0.0, 0.0
    if most == 1:
        inner = table.radius_m
        outer = 2.0 * inner if table.outer_m is None else table.outer_m
        if outer <= inner:
            raise ValueError(f"outer_m: found {outer:g}, allowed is more than radius_m, {inner:g}")
    elif most == 2:
        outer = table.reach_m or 0.0
    return Said(
        relation=table.relation,
        points=np.array(table.at, dtype=np.float64),
        yaw=radians(table.yaw_deg) if most == 2 and len(table.at) == 1 else 0.0,
        inner=inner,
        outer=outer,
        slope=table.slope,
        positive=table.positive,
        target=table.target,
    )


def observation(message: SoftObservationMessage, dimension: int) -> "SoftObservation":
    """The statement as filters over an area of `dimension` take it.

    Raises:
        ValueError: if its geometry makes no sense, such as a polygon whose edges cross.
    """
    from estimator.soft import models  # noqa: PLC0415 - numba takes its time, and words need none of it
    from estimator.soft.statement import SoftObservation  # noqa: PLC0415

    points, slope = np.asarray(message.points), message.slope
    fewest, most = POINTS[message.relation]
    if most == 1:
        model = models.ranges(points[0], message.inner, message.outer, slope, dimension=dimension)
    elif fewest == 3:
        model = models.region(points, slope, dimension=dimension)
    else:
        reach = message.outer or None
        if len(points) == 1:
            pose = np.array([points[0, 0], points[0, 1], 0.0, message.yaw])
            model = models.directions(pose, slope, reach=reach, dimension=dimension)
        else:
            model = models.wall(points[0], points[1], slope, reach=reach, dimension=dimension)
    relation = _NAMES.get(message.relation, message.relation)
    return SoftObservation.of(model, relation, positive=message.positive, target=message.target or None)


def words(message: SoftObservationMessage) -> str:
    """The statement as a person would say it."""
    who, negation = message.target or ("something" if message.positive else "nothing"), ""
    if message.target and not message.positive:
        negation = "not "
    relation = _NAMES.get(message.relation, message.relation)
    return f"{who} is {negation}{relation} {_reference(message)}"


def _reference(message: SoftObservationMessage) -> str:
    places = [f"({x:g}, {y:g})" for x, y in np.round(message.points, 1)]
    inner, outer = f"{message.inner:g}", f"{message.outer:g}"
    reach = f", up to {outer} m away" if message.outer > 0.0 else ""
    match message.relation:
        case "near":
            return f"{places[0]}, within {inner} m"
        case "around":
            return f"{places[0]}, {inner} to {outer} m away"
        case "far":
            return f"{places[0]}, over {outer} m away"
        case "inside" | "outside" if len(places) <= _SPELT_OUT:
            return f"the region {', '.join(places)}"
        case "inside" | "outside":
            x, y = np.mean(message.points, axis=0)
            return f"the region of {len(places)} corners around ({x:.1f}, {y:.1f})"
        case _ if len(places) == 1:
            return f"{places[0]} facing {degrees(message.yaw):.0f}°{reach}"
        case _:
            return f"the line from {places[0]} to {places[1]}{reach}"


def _places(fewest: int, most: int) -> str:
    return str(most) if fewest == most else f"{fewest} to {most}"
