"""A calibration gives back what the measurements were made with, within its own intervals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from estimator.calibration.calibrate import calibrate
from estimator.calibration.recording import Recording
from estimator.calibration.result import Calibration, Options
from estimator.calibration.sensor_table import sensor_table
from estimator.filter import Area
from estimator.sensors.bearing_only import BearingOnly
from estimator.sensors.range_bearing import RangeBearing

AREA = Area(np.zeros(2), np.full(2, 20.0))
TRUE: dict[str, Any] = {
    "period_s": 1.0,
    "range_sigma_m": 0.12,
    "bearing_sigma_deg": 1.5,
    "bearing_frame": "body",
    "clutter": 0.3,
    "field_of_view": "sector",
    "range_m": 9.0,
    "angle_deg": 120.0,
    "range_breaks_m": [1.0, 5.0, 9.0],
    "range_gains": [0.9, 0.7, 0.2],
}
BREAKS = (1.0, 5.0, 9.0)


def recorded(sensor: Any, seed: int, sets: int = 2000, **keys: Any) -> Recording:
    """A robot is here and there among eight targets that stand still."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 20, (2, 8))
    poses = np.zeros((sets, 4))
    poses[:, :2] = rng.uniform(0, 20, (sets, 2))
    poses[:, 3] = rng.uniform(-np.pi, np.pi, sets)
    drawn = [sensor.sample(places, pose, rng) for pose in poses]
    return Recording(
        poses=poses,
        offsets=np.append(0, np.cumsum([len(z) for z in drawn])),
        measurements=np.concatenate(drawn),
        targets=np.broadcast_to(places, (sets, 2, 8)),
        bystanders=np.zeros((sets, 2, 0)),
        **keys,
    )


def within(found: Calibration, name: str, true: list[float]) -> list[bool]:
    return [low <= x <= high for x, (low, high) in zip(true, found.intervals[name], strict=True)]


def test_a_range_bearing_sensor_is_recovered_within_the_intervals() -> None:
    good = []
    sensor = RangeBearing.of(RangeBearing.Config(**TRUE), AREA)
    for seed in range(3):
        found = calibrate(recorded(sensor, seed), Options(breaks=BREAKS, draws=100))
        good += within(found, "sigmas", [0.12, np.radians(1.5)])
        good += within(found, "biases", [0.0, 0.0])
        good += within(found, "gains", [0.9, 0.7, 0.2])
        good += within(found, "clutter", [0.3])
        assert found.sigmas["range"] == pytest.approx(0.12, rel=0.1)
        assert found.sigmas["bearing"] == pytest.approx(np.radians(1.5), rel=0.1)
        assert found.gains == pytest.approx([0.9, 0.7, 0.2], abs=0.1)
        assert found.clutter == pytest.approx(0.3, rel=0.15)
        assert np.degrees(found.opening) == pytest.approx([-60, 60], abs=1.5)
        assert found.farthest == pytest.approx(9.0, abs=0.3)
        assert found.sector_gains == pytest.approx(np.ones(9), abs=0.25)
        assert found.peaks == ()
    assert np.mean(good) > 0.7  # of 24; in 20 other recordings 144 of 160 intervals held the truth


def test_the_table_describes_a_sensor_like_the_true_one() -> None:
    true = RangeBearing.of(RangeBearing.Config(**TRUE), AREA)
    found = calibrate(recorded(true, 7), Options(breaks=BREAKS, draws=2))
    table = sensor_table(found, period=1.0, body_frame=True)
    made = RangeBearing.of(RangeBearing.Config(**table), AREA)
    points = np.random.default_rng(0).uniform(0, 20, (2, 4000))
    pose = np.array([[10.0, 10.0, 0.0, 0.4]])
    apart = np.abs(true.detection(points, pose) - made.detection(points, pose))
    assert np.quantile(apart, 0.97) < 0.1  # the rest lies at the edges
    assert (np.abs(found.measured[1]) <= np.radians(table["angle_deg"]) / 2).all()
    z = recorded(true, 8, 300).measurements
    assert np.count_nonzero(made.clutter_intensity(z, pose[0]) == 0.0) <= 0.01 * len(z)


def test_the_table_is_one_that_a_mission_takes() -> None:
    true = RangeBearing.of(RangeBearing.Config(**TRUE), AREA)
    for breaks in ((), (0.0, 4.0, 12.0), (2.0, 3.0)):
        found = calibrate(recorded(true, 9, 300), Options(breaks=breaks, draws=2))
        made = RangeBearing.of(RangeBearing.Config(**sensor_table(found, period=1.0, body_frame=True)), AREA)
        assert made.sigmas[0] == pytest.approx(found.sigmas["range"], rel=1e-3)
        assert made.clutter == pytest.approx(found.clutter, rel=1e-3)


def test_a_bearing_only_sensor_and_its_clutter_peaks_are_recovered() -> None:
    config = BearingOnly.Config(period_s=1.0, beam_separation_deg=0.0, clutter=1.5, clutter_uniform=0.6)
    true = BearingOnly.of(config, AREA)
    found = calibrate(recorded(true, 3, 4000, quantities=("bearing",)), Options(breaks=(1.0, 5.0), draws=50))
    assert np.degrees(found.sigmas["bearing"]) == pytest.approx(2.25, rel=0.1)
    assert found.gains == pytest.approx([0.79, 0.79], abs=0.06)
    assert found.clutter == pytest.approx(1.5, rel=0.06)
    assert found.clutter_uniform == pytest.approx(0.6, abs=0.06)
    assert np.degrees(found.clutter_peak) == pytest.approx(36.0, abs=6.0)
    assert sorted(np.degrees([p.centre for p in found.peaks])) == pytest.approx([-90, 90], abs=6.0)
    assert sum(p.share for p in found.peaks) == pytest.approx(0.4, abs=0.08)
    table = sensor_table(found, period=1.0, body_frame=True)
    made = BearingOnly.of(BearingOnly.Config(**table), AREA)
    assert made.clutter_uniform == pytest.approx(0.6, abs=0.06)


def test_a_sensor_that_sees_all_around_has_no_opening() -> None:
    keys = TRUE | {"angle_deg": 360.0, "bearing_frame": "world"}
    true = RangeBearing.of(RangeBearing.Config(**keys), AREA)
    found = calibrate(recorded(true, 0, 600, body_frame=False), Options(breaks=BREAKS, draws=2))
    assert found.opening == (-np.pi, np.pi)
    assert sensor_table(found, period=1.0, body_frame=False)["angle_deg"] == 360.0


def test_names_and_gates_find_the_same() -> None:
    true = RangeBearing.of(RangeBearing.Config(**TRUE), AREA)
    unnamed = recorded(true, 5, 800)
    # the nearest target in metres, if it is within half of one
    frames = unnamed.frames
    places = np.concatenate(
        [true.locate(z[None], unnamed.poses[f]) for z, f in zip(unnamed.measurements, frames, strict=True)],
        axis=1,
    )
    apart = np.linalg.norm(places[:, :, None] - unnamed.targets[0][:, None, :], axis=0)
    sources = np.where(apart.min(axis=1) < 0.6, apart.argmin(axis=1), -1)
    one, other = (
        calibrate(r, Options(breaks=BREAKS, draws=2)) for r in (unnamed, replace(unnamed, sources=sources))
    )
    assert one.sigmas["range"] == pytest.approx(other.sigmas["range"], rel=0.05)
    assert one.gains == pytest.approx(other.gains, abs=0.03)
    assert one.clutter == pytest.approx(other.clutter, rel=0.05)


def test_what_is_hidden_or_a_bystanders_does_not_count() -> None:
    true = RangeBearing.of(
        RangeBearing.Config(**TRUE | {"clutter": 0.0, "range_gains": [1.0, 1.0, 1.0]}), AREA
    )
    rng = np.random.default_rng(0)
    sets, places = 600, np.array([[4.0, 7.0], [0.0, 1.5]])
    poses = np.zeros((sets, 4))
    poses[:, 1] = rng.uniform(-0.5, 0.5, sets)
    bystander = np.array([[2.0], [0.0]])  # in front of the first target, and seen instead of it
    seen = np.concatenate([places[:, 1:], bystander], axis=1)
    drawn = [true.sample(seen, pose, rng) for pose in poses]
    recording = Recording(
        poses=poses,
        offsets=np.append(0, np.cumsum([len(z) for z in drawn])),
        measurements=np.concatenate(drawn),
        targets=np.broadcast_to(places, (sets, 2, 2)),
        bystanders=np.broadcast_to(bystander, (sets, 2, 1)),
        hidden=np.broadcast_to([True, False], (sets, 2)),
    )
    found = calibrate(recording, Options(breaks=(5.0, 8.0), draws=2))
    assert np.nanmin(found.gains) > 0.99
    assert found.clutter < 0.01
    behind = calibrate(
        replace(recording, hidden=None), Options(breaks=(3.0, 8.0), draws=2, bystander_radius=0.6)
    )
    assert np.nanmin(behind.gains) > 0.99
    wrong = calibrate(
        replace(recording, bystanders=np.zeros((sets, 2, 0))), Options(breaks=(5.0, 8.0), draws=2)
    )
    assert wrong.clutter == pytest.approx(1.0, abs=0.02)


def test_misses_that_come_in_rows_widen_the_interval() -> None:
    """A sensor blind for a hundred sets at a time is known less well than one that misses at random."""
    true = RangeBearing.of(RangeBearing.Config(**TRUE), AREA)
    fair = recorded(true, 1)
    keep = np.random.default_rng(1).random(20).repeat(100)[fair.frames] < 0.5
    counts = np.bincount(fair.frames[keep], minlength=len(fair.poses))
    blind = replace(fair, measurements=fair.measurements[keep], offsets=np.append(0, np.cumsum(counts)))
    spans = []
    for recording in (fair, blind):
        found = calibrate(recording, Options(breaks=BREAKS, draws=60, stretches=20))
        low, high = found.intervals["gains"][1]
        spans.append((high - low) / found.gains[1])
    assert spans[1] > 3 * spans[0]


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"poses": np.zeros((0, 4))}, "poses"),
        ({"poses": np.full((5, 4), np.nan)}, "poses"),
        ({"offsets": np.arange(5)}, "offsets"),
        ({"offsets": np.array([0, 2, 1, 3, 4, 5])}, "offsets"),
        ({"measurements": np.full((5, 2), np.inf)}, "measurements"),
        ({"measurements": np.zeros((5, 3))}, "measurements"),
        ({"targets": np.zeros((5, 2, 0))}, "targets"),
        ({"targets": np.full((5, 2, 1), np.nan)}, "targets"),
        ({"bystanders": np.zeros((4, 2, 1))}, "bystanders"),
        ({"quantities": ("depth", "bearing")}, "quantities"),
        ({"sources": np.full(5, 9)}, "sources"),
        ({"hidden": np.zeros((5, 7), dtype=bool)}, "hidden"),
    ],
)
def test_a_wrong_recording_is_refused_by_name(keys: dict[str, Any], says: str) -> None:
    right: dict[str, Any] = {
        "poses": np.zeros((5, 4)),
        "offsets": np.arange(6),
        "measurements": np.ones((5, 2)),
        "targets": np.ones((5, 2, 3)),
        "bystanders": np.zeros((5, 2, 0)),
    }
    with pytest.raises(ValueError, match=says):
        Recording(**right | keys)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"range_gate": 0.0}, "range_gate"),
        ({"bearing_gate": np.nan}, "bearing_gate"),
        ({"breaks": (1.0,)}, "breaks"),
        ({"breaks": (3.0, 2.0)}, "breaks"),
        ({"draws": 1}, "draws"),
    ],
)
def test_wrong_options_are_refused_by_name(keys: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Options(**keys)


def test_too_few_sightings_are_one_clear_error() -> None:
    true = RangeBearing.of(RangeBearing.Config(**TRUE), AREA)
    few = recorded(true, 0, 8)
    with pytest.raises(ValueError, match="too few"):
        calibrate(few)
    none = replace(few, measurements=np.zeros((0, 2)), offsets=np.zeros(9, np.int64))
    with pytest.raises(ValueError, match="too few"):
        calibrate(none)
