import numpy as np
import pytest

from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.allocation.information import ENTRANCES, InformationRules, learnt
from planner.allocation.tasks import Task
from tests.planner.problems import NumpySensor

RULES = InformationRules(step=5.0, period=1.0)


def sensor(dimension=2, **more):
    config = RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=1.0,
        bearing_sigma_deg=2.0,
        elevation_sigma_deg=2.0 if dimension == 3 else None,
        reach_m=[20.0] * dimension,
        gain=0.9,
        **more,
    )
    return RangeBearing.of(config, Area(np.zeros(dimension), np.full(dimension, 100.0)))


def cluster(means, covariances, masses):
    means, masses = np.array(means, dtype=float).T, np.array(masses, dtype=float)
    place = means @ (masses / masses.sum())
    spread = float(np.sqrt((((means - place[:, None]) ** 2).sum(axis=0) * masses / masses.sum()).sum()))
    return Task("refine-0", "refine", place, spread, masses.sum(), means, masses, np.array(covariances))


def test_one_look_learns_what_the_fisher_information_says():
    """One target, one look: checked against (7)-(11), written out for the best of the nine steps."""
    model, covariance = sensor(), np.diag([30.0, 10.0])
    task = cluster([(50, 50)], [covariance], [1.0])
    rules = InformationRules(step=5.0, period=1.0, margin=12.0, looks=1)
    made = learnt(model, [task], rules, 0.0)
    for e in range(ENTRANCES):
        place = task.place + 12.0 * made.directions[e]
        assert made.entrances[0, e] == pytest.approx(place)
        best = np.inf
        for move in [(0, 0), *((np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 4)]:
            pose = np.array([*(place + 5.0 * np.array(move)), 0.0, 0.0])
            H = model.jacobian(task.points, pose)[0]
            seen = model.detection(task.points, pose[None])[0, 0]
            after = np.linalg.inv(np.linalg.inv(covariance) + seen * H.T @ np.linalg.inv(model.noise) @ H)
            best = min(best, np.trace(after))
        assert made.score[0, e] == pytest.approx((40.0 - best) / (40.0 + 2 * 0.25**2), rel=1e-6)
        assert made.seconds[0, e] == 1.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_more_looks_learn_more_and_never_more_than_there_is(dimension):
    rng = np.random.default_rng(0)
    means = 50 + rng.normal(0, 8, (4, dimension))
    task = cluster(means, [25 * np.eye(dimension)] * 4, [1.0, 2.0, 0.5, 1.0])
    scores = [
        learnt(sensor(dimension), [task], InformationRules(5.0, 1.0, looks=k), 10.0).score for k in (1, 3, 9)
    ]
    assert (scores[0] < scores[1]).all()
    assert (scores[1] <= scores[2] + 1e-12).all()
    assert (scores[2] < 4.5).all()


def test_what_is_known_already_is_worth_less_and_fuel_costs():
    wide = cluster([(50, 50)], [100 * np.eye(2)], [1.0])
    narrow = cluster([(50, 50)], [0.01 * np.eye(2)], [1.0])
    made = learnt(sensor(), [wide, narrow], RULES, 0.0)
    assert made.score[0].min() > 0.9
    assert made.score[1].max() < 0.2
    costly = learnt(sensor(), [wide], InformationRules(5.0, 1.0, fuel=0.01), 0.0)
    assert costly.score[0] == pytest.approx(made.score[0] - 0.01 * costly.seconds[0])


def test_the_score_does_not_depend_on_where_the_cluster_is_nor_on_its_neighbours_in_the_call():
    a = cluster([(20, 20), (25, 22)], [np.diag([9.0, 4.0])] * 2, [1.0, 2.0])
    b = cluster([(70, 60), (75, 62)], [np.diag([9.0, 4.0])] * 2, [1.0, 2.0])
    big = cluster([(5, 5), (9, 9), (1, 9)], [np.eye(2)] * 3, [1.0, 1.0, 1.0])
    made = learnt(sensor(), [a, big, b], RULES, 0.0)
    assert made.score[0] == pytest.approx(made.score[2])
    assert made.score[0] == pytest.approx(learnt(sensor(), [a], RULES, 0.0).score[0])


def test_no_task_and_a_sensor_without_a_jacobian_have_an_answer():
    assert learnt(sensor(), [], RULES, 0.0).score.shape == (0, ENTRANCES)
    task = cluster([(50, 50)], [np.eye(2)], [2.0])
    made = learnt(NumpySensor(2), [task], RULES, 0.0)
    assert (made.score == 2.0).all()
    assert (made.seconds == 0.0).all()


@pytest.mark.parametrize(
    "covariance", [np.zeros((2, 2)), np.diag([25.0, 0.0]), np.diag([1e9, 1e-12]), -np.eye(2)]
)
@pytest.mark.parametrize("step", [5.0, 0.0])
def test_degenerate_covariances_and_looks_from_the_target_itself_give_finite_scores(covariance, step):
    """The bearing of a target that one stands on says where it is to within nothing."""
    task = cluster([(50, 50)], [covariance], [1.0])
    rules = InformationRules(step=step, period=1.0, margin=step, looks=4)
    made = learnt(sensor(), [task], rules, 0.0)
    assert np.isfinite(made.score).all()
    assert (made.score <= 1.0).all()
