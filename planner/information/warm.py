"""Every kernel of this room once, so that no robot compiles in flight."""

import numpy as np

from planner.information.gains import Fixed, information, options
from planner.information.mutual import mutual_information


def warm_information() -> None:
    """Two robots with one step each, over two points."""
    detection, weights, clutter = np.full((1, 1, 2), 0.5), np.ones(2), np.ones(1)
    some = options(detection, weights, clutter, 2)
    fixed = Fixed.of(detection[0], weights, clutter, 2).with_action(some, 0)
    information(fixed, some)
    assert np.isfinite(fixed.information)
    mutual_information(detection[0], weights, clutter)
