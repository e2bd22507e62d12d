"""Where a robot was is remembered for a while, and nothing is made up."""

from math import pi

import numpy as np
import pytest

from agents.robot.pose_history import PoseHistory


def history(*poses: tuple[float, float, float]) -> PoseHistory:
    """Of times, x and yaw."""
    made = PoseHistory()
    for time, x, yaw in poses:
        made.add(time, np.array([x, 0.0, 5.0, yaw]))
    return made


def test_between_two_poses_it_went_straight_and_turned_the_shorter_way() -> None:
    made = history((1.0, 0.0, pi - 0.1), (2.0, 10.0, -pi + 0.1))
    pose = made.at(1.25)
    assert pose is not None
    assert pose[:3] == pytest.approx([2.5, 0.0, 5.0])
    assert pose[3] == pytest.approx(pi - 0.05)
    half = made.at(1.75)
    assert half is not None
    assert half[3] == pytest.approx(-pi + 0.05)


@pytest.mark.parametrize(
    ("time", "known"), [(0.9, False), (1.0, True), (2.0, True), (2.4, True), (2.6, False)]
)
def test_what_nobody_remembers_is_not_made_up(time: float, known: bool) -> None:
    assert (history((1.0, 0.0, 0.0), (2.0, 1.0, 0.0)).at(time) is not None) == known
    assert PoseHistory().at(time) is None


def test_it_forgets_after_a_while_and_does_not_go_back() -> None:
    made = history(*((0.1 * i, float(i), 0.0) for i in range(1000)))
    assert made.at(80.0) is None
    assert made.at(95.0) is not None
    made.add(50.0, np.zeros(4))
    newest = made.at(99.9)
    assert newest is not None
    assert newest[0] == pytest.approx(999.0)
