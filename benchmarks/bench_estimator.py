"""How long the particle filter takes, and Stone Soup's on the same input in the same run."""

import time
from datetime import datetime
from typing import Any

import numpy as np
import pytest

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.kmeans import kmeans
from estimator.smc.smc_phd import SmcPhd, SmcPhdState

SIDE, TARGETS, SIGMA = 200.0, 12, 0.5
AREA = Area(np.zeros(2), np.full(2, SIDE))
SENSOR = RangeBearing.of(
    RangeBearing.Config(
        period_s=1.0, range_sigma_m=SIGMA, bearing_sigma_deg=0.5, reach_m=[20.0, 20.0], gain=0.98, clutter=1.0
    ),
    AREA,
)
POSE = np.array([100.0, 100.0, 10.0, 0.0])
UNITS = {"unit": "ms"}


def scene(particles: int) -> tuple[SmcPhd, SmcPhdState, FloatArray]:
    """Half of the particles lie evenly in the area, half about twelve targets; one measurement of each."""
    rng = np.random.default_rng(1)
    targets = rng.uniform(0.0, SIDE, (2, TARGETS))
    clouds = targets[:, rng.integers(0, TARGETS, particles // 2)] + SIGMA * rng.standard_normal(
        (2, particles // 2)
    )
    filter = SmcPhd(SmcPhd.Config(particles=particles, expected_targets=5.0))
    state = filter.init(AREA, rng)
    positions = np.concatenate([rng.uniform(0.0, SIDE, (2, particles - particles // 2)), clouds], axis=1)
    state = SmcPhdState(
        states=np.ascontiguousarray(positions[:, rng.permutation(particles)]),
        weights=np.full(particles, TARGETS / particles),
        labels=np.full(particles, -1),
        undetected=state.undetected,
        centres=state.centres,
        reach=state.reach,
    )
    z = SENSOR.measure(targets, POSE)
    return filter, state, z + rng.standard_normal(z.shape) * SENSOR.sigmas


def stone_soup_ms(state: SmcPhdState, z: FloatArray, repeats: int = 3) -> float:
    """Stone Soup's SMC-PHD update of the same particles and measurements, without resampling; the best."""
    from stonesoup.models.measurement.nonlinear import CartesianToBearingRange  # noqa: PLC0415
    from stonesoup.types.array import StateVector, StateVectors  # noqa: PLC0415
    from stonesoup.types.detection import Detection  # noqa: PLC0415
    from stonesoup.types.hypothesis import SingleHypothesis  # noqa: PLC0415
    from stonesoup.types.multihypothesis import MultipleHypothesis  # noqa: PLC0415
    from stonesoup.types.prediction import ParticleStatePrediction  # noqa: PLC0415
    from stonesoup.updater.particle import SMCPHDUpdater  # noqa: PLC0415

    when = datetime(2024, 1, 1)
    model = CartesianToBearingRange(
        ndim_state=2,
        mapping=(0, 1),
        noise_covar=np.diag(SENSOR.sigmas[::-1] ** 2),
        translation_offset=StateVector(POSE[:2]),
    )
    prediction = ParticleStatePrediction(
        StateVectors(state.positions), log_weight=np.log(state.weights), timestamp=when
    )
    hypotheses: list[Any] = [
        SingleHypothesis(prediction, Detection(StateVector([b, r]), timestamp=when, measurement_model=model))
        for r, b in z
    ]
    multiple = MultipleHypothesis([*hypotheses, SingleHypothesis(prediction, None)])
    updater = SMCPHDUpdater(
        measurement_model=model, resampler=None, prob_detect=0.3, clutter_intensity=SENSOR.clutter / 1777.0
    )
    best = float("inf")
    for _ in range(repeats):
        began = time.perf_counter()
        updater.update(multiple)
        best = min(best, time.perf_counter() - began)
    return 1e3 * best


def run_update(benchmark: Any, particles: int, asked: float, repeats: int, quick: bool) -> None:
    """The whole update: p_D, gating, likelihoods, weights, undetected intensity; no resampling is due."""
    filter, state, z = scene(particles)
    rng = np.random.default_rng(2)
    benchmark.extra_info.update(UNITS, asked=asked, note="update without resampling")
    after = filter.update(state, SENSOR, POSE, z, rng)
    assert after.weights.size >= particles
    benchmark(filter.update, state, SENSOR, POSE, z, rng)
    if quick:
        return
    peer = stone_soup_ms(state, z, repeats)
    benchmark.extra_info["peers"] = {"stonesoup 1.9 SMCPHDUpdater without resampling": peer}


def test_smc_phd_10k_12(benchmark: Any, quick: bool) -> None:
    run_update(benchmark, 10_000, 0.3, 3, quick)


def test_smc_phd_100k_12(benchmark: Any, quick: bool) -> None:
    run_update(benchmark, 100_000, 8.0, 1, quick)


@pytest.mark.figures("smc_phd_growth", "smc_phd_growth_10k", "smc_phd_growth_100k", "smc_phd_growth_1m")
def test_smc_phd_growth(benchmark: Any, quick: bool) -> None:
    """Update time per particle and gated measurement: the mean number of measurements that reach a particle
    is 0.5 in this scene whatever its size, so linear growth means a time per particle that stays."""
    made, each = [], []
    for particles, label in ((10_000, "10k"), (100_000, "100k"), (1_000_000, "1m")):
        filter, state, z = scene(particles)
        rng = np.random.default_rng(2)
        pairs = int(SENSOR.look(state.positions, POSE, z).indices.size)
        times = []
        for _ in range(3 if quick else 10):
            began = time.perf_counter()
            filter.update(state, SENSOR, POSE, z, rng)
            times.append(time.perf_counter() - began)
        taken = 1e3 * float(np.median(times[1:]))
        each.append(1e6 * taken / pairs)
        more = {"particles": particles, "gated pairs": pairs, "ns per gated pair": each[-1]}
        made.append({"name": f"smc_phd_growth_{label}", "value": taken, "unit": "ms", "more": more})
    ratio = {
        "name": "smc_phd_growth",
        "value": each[2] / each[0],
        "unit": "",
        "asked": 1.5,
        "note": "time per gated pair of particle and measurement, 10^6 particles against 10^4; 1 is linear",
    }
    benchmark.extra_info["figures"] = [ratio, *made]
    benchmark.pedantic(lambda: None, rounds=1)


def run_resampling(benchmark: Any, particles: int) -> None:
    """What an update costs more when resampling with jitter is due."""
    filter, state, z = scene(particles)
    rng = np.random.default_rng(2)
    state, _ = filter.clusters(filter.update(state, SENSOR, POSE, z, rng), rng)
    benchmark.extra_info.update(UNITS, note="systematic resampling and jitter, comes on top when it is due")
    filter.resampled(state, rng)
    benchmark(filter.resampled, state, rng)


def test_smc_phd_10k_resampling(benchmark: Any) -> None:
    run_resampling(benchmark, 10_000)


def test_smc_phd_100k_resampling(benchmark: Any) -> None:
    run_resampling(benchmark, 100_000)


def test_kmeans_10k_12(benchmark: Any) -> None:
    """Seeding included; 500 of the particles are strays."""
    rng = np.random.default_rng(3)
    centres = rng.uniform(0.0, SIDE, (2, TARGETS))
    x = centres[:, rng.integers(0, TARGETS, 10_000)] + SIGMA * rng.standard_normal((2, 10_000))
    x[:, :500] = rng.uniform(0.0, SIDE, (2, 500))
    w = np.full(10_000, TARGETS / 10_000)
    benchmark.extra_info.update(UNITS, asked=3.0, note="seeding, iterations, splitting, moments")
    found, _ = kmeans(x, w, 3.0 * SIGMA)
    assert found.masses.size == TARGETS
    benchmark(kmeans, x, w, 3.0 * SIGMA)
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415

    best = float("inf")
    for seed in range(5):
        began = time.perf_counter()
        kmeans2(x.T, TARGETS, minit="++", seed=seed)
        best = min(best, time.perf_counter() - began)
    benchmark.extra_info["peers"] = {"scipy kmeans2, k-means++ (no weights, no trimming)": 1e3 * best}
