"""Every kernel of this room once, so that no robot compiles in flight."""

import numpy as np

from estimator.filter import Area
from planner.information.actions import Scales, action_set, part
from planner.information.events import most_alone
from planner.information.gains import Fixed, information, options
from planner.information.mutual import mutual_information


def warm_information() -> None:
    """Two robots with one step each, over two points."""
    detection, weights, clutter = np.full((1, 1, 2), 0.5), np.ones(2), np.ones(1)
    some = options(detection, weights, clutter, 2)
    fixed = Fixed.of(detection[0], weights, clutter, 2).with_action(some, 0)
    information(fixed, some)
    area = Area(np.zeros(2), np.ones(2))
    actions = action_set(np.full(4, 0.5), area, Scales(0.2, 2.0, 1, 2, 0.7), turns=True)
    part(actions.corners[0], 0.5)
    most_alone(detection[0], weights, clutter, 2)
    assert np.isfinite(fixed.information)
    mutual_information(detection[0], weights, clutter)
