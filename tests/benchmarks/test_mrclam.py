"""The first 100 seconds of the real recording through every filter."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from benchmarks import mrclam

pytestmark = [
    pytest.mark.data,
    pytest.mark.skipif(not mrclam.DATA.is_dir(), reason=f"{mrclam.DATA} is not there"),
]


def test_all_sets_of_all_robots_are_in_the_order_of_capture() -> None:
    sets = mrclam.recording(0.3).sets
    assert len(sets) == 18180
    assert all(a.time <= b.time for a, b in pairwise(sets))
    assert {each.robot for each in sets} == {"r1", "r2", "r3", "r4", "r5"}


@pytest.mark.parametrize(
    ("way", "kind", "matched", "false", "metres"),
    [
        (mrclam.run, "lmb", 14, 1, 0.12),
        (mrclam.run, "gm_phd", 12, 2, 0.15),
        (mrclam.search, "smc_phd", 12, 0, 0.12),
        (mrclam.search, "gm_phd", 12, 0, 0.12),
    ],
)
def test_the_first_100_s_show_most_landmarks_and_next_to_nothing_else(
    way: Callable[..., mrclam.Course], kind: str, matched: int, false: int, metres: float
) -> None:
    course = way(kind, 0, 100.0)
    errors = course.errors()[-1]
    there = int(np.isfinite(errors).sum())
    assert there >= matched
    assert course.estimates[-1].shape[1] - there <= false
    assert np.nanmax(errors) < metres
