"""Where a vehicle may be sent, and when it has broken out."""

import numpy as np
import pytest

from bridges.mavlink.fence import Fence
from estimator.filter import Area
from planner.ground.build import GroundPlan, built
from planner.ground.shapes import Shape

LOW, HIGH = np.array([0.0, 0.0]), np.array([100.0, 50.0])


def fence(**changes: object) -> Fence:
    return Fence(**{"low": LOW, "high": HIGH, "altitude": (1.0, 60.0), "margin": 10.0, **changes})  # type: ignore[arg-type]


def keeping_out() -> Fence:
    disc = Shape.disc(50.0, 25.0, 12.0)
    plan = GroundPlan(
        map=None,
        obstacles=(),
        keep_out=(disc,),
        fences=(),
        radius=0.0,
        room=0.0,
        resolution=1.0,
        layer=None,
        altitude=None,
        climb=False,
    )
    ground = built(plan, Area(LOW, HIGH), np.array([[5.0], [5.0], [10.0]]))
    return fence(ground=ground, margin=3.0)


@pytest.mark.parametrize(
    ("place", "word"),
    [
        ((50, 25, 0.5), "altitudes"),
        ((50, 25, 61), "altitudes"),
        ((-11, 25, 10), "outside of the mission's area"),
        ((50, 61, 10), "outside of the mission's area"),
        ((np.nan, 25, 10), "outside"),
        ((50, 25, np.nan), "altitudes"),
        ((np.inf, 25, 10), "outside"),
    ],
)
def test_nothing_is_sent_out_of_bounds(place: tuple[float, float, float], word: str) -> None:
    said = fence().forbids(np.array(place, float))
    assert said is not None
    assert word in said


@pytest.mark.parametrize("place", [(50, 25, 10), (-9, 25, 1), (109, 59, 60)])
def test_everything_else_may_be_flown_to(place: tuple[float, float, float]) -> None:
    assert fence().forbids(np.array(place, float)) is None
    assert fence().left(np.array(place, float)) is None


def test_a_vehicle_on_the_ground_has_not_broken_out() -> None:
    assert fence().left(np.array([50.0, 25.0, -0.3])) is None
    assert keeping_out().left(np.array([20.0, 25.0, 0.0])) is None


def test_it_has_broken_out_one_margin_further_than_it_may_be_sent() -> None:
    assert fence().left(np.array([-19.0, 25.0, 10.0])) is None
    assert "outside" in str(fence().left(np.array([-21.0, 25.0, 10.0])))
    assert fence().left(np.array([50.0, 25.0, 69.0])) is None
    assert "60 m" in str(fence().left(np.array([50.0, 25.0, 71.0])))


def test_keep_out_zones_are_kept_out_of_and_the_edge_of_one_is_no_breach() -> None:
    one = keeping_out()
    assert "keep-out zone" in str(one.forbids(np.array([50.0, 25.0, 10.0])))
    assert one.forbids(np.array([70.0, 25.0, 10.0])) is None
    assert "keep-out zone" in str(one.forbids(np.array([40.0, 25.0, 10.0])))
    assert one.left(np.array([39.5, 25.0, 10.0])) is None  # pushed in by 1.5 m
    assert "keep-out zone" in str(one.left(np.array([50.0, 25.0, 10.0])))
