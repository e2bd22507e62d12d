"""Where a target may be that was looked for in vain."""

import math

import numpy as np
import pytest

from estimator.sensors.field_of_view import FieldOfView
from planner.mpc.suspects import Suspects, careful_speed, places_of

VIEW = FieldOfView(2, "sector", 1.0, np.array([0.0, 5.0, math.radians(60)]))
HERE, STANDING = np.array([20.0, 20.0]), np.zeros(2)


class Sensor:
    dimension = 2
    detection = staticmethod(VIEW.detection)


def looked(*poses, time=10.0):
    suspects = Suspects()
    suspects.looks.extend((time, np.array(pose)) for pose in poses)
    return suspects


def doubted(suspects, sigma, time=10.0):
    return suspects.doubted(Sensor, HERE, sigma**2 * np.eye(2), STANDING, time, 0.0, 1.5)


def test_what_was_looked_at_in_vain_is_suspected_less_and_moves_with_the_target():
    places = places_of(HERE, 16.0 * np.eye(2))
    assert np.cov(places)[0, 0] == pytest.approx(16.0, rel=0.2)  # cut off at 2.5 sigmas
    pose = np.array([18.0, 20.0, 0.0, 0.0])
    suspects = looked(pose)
    velocity = np.array([0.5, 0.0])
    seen = VIEW.detection(np.ascontiguousarray(places), pose[None])[0] > 0.5
    np.testing.assert_allclose(suspects.missed(Sensor, places, velocity, 10.0, 0.0), np.where(seen, 0.0, 1.0))
    later = suspects.missed(Sensor, places + np.array([[2.0], [0.0]]), velocity, 14.0, 0.0)
    assert later[seen].max() < 0.1
    assert later[~seen].min() == 1.0


def test_an_estimate_that_was_in_full_view_in_vain_is_wrong_and_the_more_so_the_longer():
    suspects = looked([17.0, 20.0, 0.0, 0.0])
    assert doubted(suspects, 0.5)[0, 0] == pytest.approx(0.5**2 + 1.5**2)
    assert doubted(suspects, 0.5, 14.0)[0, 0] == pytest.approx(0.5**2 + 1.5**2 + (0.3 * 4.0) ** 2)


def test_a_look_elsewhere_says_nothing_against_an_estimate():
    suspects = looked([30.0, 20.0, 0.0, 0.0])
    np.testing.assert_array_equal(doubted(suspects, 0.5), 0.25 * np.eye(2))


def test_a_wide_estimate_is_not_wrong_because_its_middle_was_looked_at_in_vain():
    middle = [17.0, 20.0, 0.0, 0.0]
    np.testing.assert_array_equal(doubted(looked(middle), 5.0), 25.0 * np.eye(2))
    poses = [
        np.array([x, y, 0.0, yaw])
        for x in np.arange(8.0, 33.0, 4.0)
        for y in np.arange(8.0, 33.0, 4.0)
        for yaw in (0.0, 2.0, 4.0)
    ]
    assert doubted(looked(*poses), 5.0)[0, 0] == pytest.approx(25.0 + 1.5**2)


def test_the_careful_speed_leaves_room_to_stop():
    for room, reaction, braking in [(1.7, 1.0, 3.0), (3.3, 0.5, 1.0)]:
        v = careful_speed(room, reaction, braking)
        assert v * reaction + v**2 / (2 * braking) == pytest.approx(room)
