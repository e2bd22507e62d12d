"""How the undetected intensity moves: mass, uniformity, closed forms, and simulated targets."""

import numpy as np
import pytest

from estimator.arrays import BoolArray, FloatArray
from estimator.diffusion import blurred, exchanged, parted, shifted
from estimator.filter import Area
from estimator.grid import node_volumes
from estimator.maps.occupancy import OccupancyMap
from estimator.motion import Motion, MotionConfig
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.state import moved
from estimator.undetected import Undetected

LOW, HIGH = np.zeros(2), np.array([40.0, 30.0])
SHAPE = (41, 31)
VOLUMES = node_volumes(SHAPE, LOW, HIGH)
STEPS = np.ones(2)


def bump(x: float, y: float) -> FloatArray:
    values = np.zeros(SHAPE)
    values[int(x), int(y)] = 1.0
    return values


def walls() -> BoolArray:
    """A wall two thick along x = 20, with a door, and a pillar."""
    free = np.ones(SHAPE, dtype=np.bool_)
    free[20:22, :12] = False
    free[20:22, 15:] = False
    free[5:9, 5:9] = False
    return free


def test_a_random_walk_blurs_as_a_normal_step_far_from_the_borders() -> None:
    later = blurred(bump(20, 15), STEPS, 9.0)
    x, y = np.meshgrid(np.arange(41.0), np.arange(31.0), indexing="ij")
    normal = np.exp(-((x - 20) ** 2 + (y - 15) ** 2) / 18.0) / (18.0 * np.pi)
    assert np.allclose(later, normal, atol=0.03 * normal.max())  # the nodes are a third of a step apart
    assert np.sum(later * VOLUMES * (x - 20) ** 2) == pytest.approx(9.0, rel=1e-3)


@pytest.mark.parametrize("variance", [0.01, 4.0, 1e4])
def test_blurring_keeps_mass_and_sign_and_what_is_uniform(variance: float) -> None:
    rng = np.random.default_rng(0)
    for free in (None, walls()):
        open_space = np.ones(SHAPE) if free is None else free.astype(float)
        values = rng.random(SHAPE) * open_space
        later = blurred(values, STEPS, variance, free)
        assert np.sum(later * VOLUMES) == pytest.approx(np.sum(values * VOLUMES), rel=1e-12)
        assert later.min() >= 0.0
        assert np.allclose(later * (1.0 - open_space), 0.0, atol=1e-15)
        assert np.allclose(blurred(open_space, STEPS, variance, free), open_space, atol=1e-12)


def test_blurring_twice_is_blurring_once_for_longer() -> None:
    values = np.random.default_rng(1).random(SHAPE)
    twice = blurred(blurred(values, STEPS, 2.0), STEPS, 3.0)
    assert np.allclose(twice, blurred(values, STEPS, 5.0), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_shifting_keeps_mass_and_sign_and_what_is_uniform(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for free in (None, walls()):
        open_space = np.ones(SHAPE) if free is None else free.astype(float)
        parts = parted(rng.random(SHAPE) * open_space)
        even = parted(open_space)
        before = parts.sum(axis=(0, 1))
        for _ in range(20):
            cells = (int(rng.integers(0, 3)), int(rng.integers(0, 3)))
            parts, even = shifted(parts, cells, free), shifted(even, cells, free)
        assert np.sum(parts.sum(axis=(0, 1)) * VOLUMES) == pytest.approx(np.sum(before * VOLUMES), rel=1e-12)
        assert parts.min() >= 0.0
        assert np.allclose(even, parted(open_space), atol=1e-12)


def test_shifted_parts_go_four_ways_and_come_back_from_the_border() -> None:
    parts = shifted(parted(bump(20, 15)), (3, 2))
    values = parts.sum(axis=(0, 1))
    assert {(int(i), int(j)) for i, j in np.argwhere(values > 0)} == {(17, 13), (17, 17), (23, 13), (23, 17)}
    assert np.allclose(shifted(parts, (77, 58)), parted(bump(20, 15)))  # once to and fro, on both axes


def test_exchange_makes_all_directions_alike_and_moves_nothing() -> None:
    parts = shifted(parted(bump(20, 15)), (3, 2))
    mixed = exchanged(parts, 0.5)
    assert np.allclose(mixed.sum(axis=(0, 1)), parts.sum(axis=(0, 1)))
    assert np.allclose(exchanged(parts, 1.0), parted(parts.sum(axis=(0, 1))))


SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0,
        range_sigma_m=1.0,
        bearing_sigma_deg=1.0,
        field_of_view="sector",
        range_m=8.0,
        angle_deg=360.0,
    ),
    Area(LOW, HIGH),
)
POSE = np.array([20.0, 15.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "config",
    [
        MotionConfig(kind="random_walk", drift=1.5),
        MotionConfig(kind="constant_velocity", speed=1.0, acceleration=0.0),
        MotionConfig(kind="constant_velocity", speed=1.0, acceleration=0.7),
    ],
)
def test_a_place_looked_at_fills_up_again_as_simulated_targets_fill_it(config: MotionConfig) -> None:
    """Mass within 8 m of a look that would have seen everything there, over time."""
    area, rng = Area(LOW, HIGH), np.random.default_rng(0)
    motion = Motion(2, config)
    grid = Undetected.uniform(area, SHAPE, 10.0).after(SENSOR, POSE)
    x = rng.uniform(LOW[:, None], HIGH[:, None], (2, 40_000))
    states = x
    if motion.state_size == 4:
        states = np.concatenate([x, config.speed * rng.standard_normal(x.shape)])
    states = np.ascontiguousarray(states[:, SENSOR.detection(x, POSE)[0] == 0.0])
    nodes = grid.nodes()
    near = np.hypot(nodes[0] - 20.0, nodes[1] - 15.0) < 8.0
    for _ in range(12):
        grid = grid.later(1.0, 0.0, motion, 1.0)
        states = moved(states, motion, 1.0, area, rng)
        simulated = np.mean(np.hypot(states[0] - 20.0, states[1] - 15.0) < 8.0) * grid.mass()
        assert grid.node_masses()[near].sum() == pytest.approx(simulated, abs=0.25)  # of 1.3 in the end
    assert grid.mass() == pytest.approx(10.0 * states.shape[1] / 40_000, rel=0.02)


def test_births_survival_and_looks_go_on_beside_the_motion() -> None:
    area = Area(LOW, HIGH)
    motion = Motion(2, MotionConfig(kind="constant_velocity", speed=2.0))
    grid = Undetected.uniform(area, SHAPE, 4.0).later(0.5, 1.0, motion, 0.7)
    assert grid.mass() == pytest.approx(3.0)
    looked = grid.after(SENSOR, POSE)
    kept = 1.0 - SENSOR.detection(grid.nodes(), POSE)[0]
    assert np.allclose(looked.values.ravel(), grid.values.ravel() * kept)
    again = looked.later(1.0, 0.0, motion, 3.0)
    assert again.mass() == pytest.approx(looked.mass())
    assert again.parts is not None
    assert np.allclose(again.parts.sum(axis=(0, 1)), again.values)


def test_the_length_of_a_step_does_not_matter() -> None:
    motion = Motion(2, MotionConfig(kind="constant_velocity", speed=0.9))
    start = Undetected.uniform(Area(LOW, HIGH), SHAPE, 4.0).after(SENSOR, POSE)
    once, often = start.later(1.0, 0.0, motion, 8.0), start
    for _ in range(32):
        often = often.later(1.0, 0.0, motion, 0.25)
    assert np.sum(np.abs(often.values - once.values) * VOLUMES) < 0.1


def test_nothing_moves_into_the_walls_of_a_map() -> None:
    cells = np.zeros((30, 40), np.uint8)
    cells[:, 20:22] = 1
    area = Area(LOW, HIGH, OccupancyMap(cells, 1.0, np.zeros(3)))
    for config in (
        MotionConfig(kind="random_walk", drift=0.5),
        MotionConfig(kind="constant_velocity", speed=0.8),
    ):
        motion, rng = Motion(2, config), np.random.default_rng(0)
        grid = Undetected.uniform(area, SHAPE, 5.0)
        left = np.where(grid.nodes()[0].reshape(SHAPE) < 20.0, grid.values, 0.0)
        grid = Undetected(left, area)
        states = np.concatenate([rng.uniform(1.0, 19.0, (2, 500)), 0.8 * rng.standard_normal((2, 500))])
        states = np.ascontiguousarray(states[: motion.state_size])
        for _ in range(40):
            grid = grid.later(1.0, 0.0, motion, 0.5)
            states = moved(states, motion, 0.5, area, rng)
        assert grid.values[20:22].max() == pytest.approx(0.0, abs=1e-12)
        assert grid.mass() == pytest.approx(np.sum(left * VOLUMES))
        assert area.is_free(states[:2]).all()
