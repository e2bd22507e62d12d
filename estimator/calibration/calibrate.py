"""A sensor's parameters, with 95% intervals, from measurements of a known truth."""

from dataclasses import replace

import numpy as np

from estimator.arrays import FloatArray, IntArray
from estimator.calibration.association import associate, errors_at
from estimator.calibration.detection import fit_reach
from estimator.calibration.noise import Noise, fit_noise, responsibilities
from estimator.calibration.recording import Geometry, Recording, geometry
from estimator.calibration.resampling import multiplicities
from estimator.calibration.result import Calibration, Options
from estimator.calibration.stretches import Stretches

_ROUNDS = 12  # of association and noise in turn; two or three settle it


def calibrate(recording: Recording, options: Options | None = None) -> Calibration:
    """Noise, p_D and clutter of one sensor.

    Who was measured is found by gating and weighing (`association`, `noise`) unless the recording says so.
    p_D counts sightings among the targets that nobody and nothing hid. What is neither a target's nor a
    bystander's is clutter, and so is a sighting whose error is no noise.

    Raises:
        ValueError: if an argument is wrong or there are too few sightings; names it.
    """
    options = options or Options()
    seen = geometry(recording)
    gate = np.array(
        [options.range_gate if q == "range" else options.bearing_gate for q in recording.quantities]
    )
    owner, noise, share = _matched(recording, seen, gate)
    reach = options.reach
    if "range" not in recording.quantities and np.isinf(reach):
        reach = _reach(recording, seen, owner, share)
    if np.isfinite(reach):
        near = np.where(
            seen.ranges[:, None, : recording.targets.shape[2]] <= reach, recording.targets, np.nan
        )
        recording = replace(recording, targets=near)
        seen = geometry(recording)
        owner, noise, share = _matched(recording, seen, gate)
    fit = Stretches.of(recording, seen, owner, share, gate, options)
    ones = np.ones((1, fit.count))
    main = fit.estimates(ones, noise, start=None)
    draws = fit.estimates(
        multiplicities(fit.count, options.draws, np.random.default_rng(options.seed)), noise, start=noise
    )
    return fit.calibration(main, draws, noise)


def _reach(recording: Recording, seen: Geometry, owner: IntArray, share: FloatArray) -> float:
    """How far a sensor sees whose measurements do not tell: directions agree by accident at any range."""
    targets = recording.targets.shape[2]
    ranges = seen.ranges[:, :targets]
    edges = np.linspace(0.0, np.nanmax(ranges), 81)
    rows = np.flatnonzero((owner >= 0) & (owner < targets))
    trials = np.histogram(ranges[np.isfinite(ranges)], edges)[0].astype(np.float64)
    hits = np.histogram(ranges[recording.frames[rows], owner[rows]], edges, weights=share[rows])[0]
    return float(edges[max(1, fit_reach(trials, hits))])


def _matched(recording: Recording, seen: Geometry, gate: FloatArray) -> tuple[IntArray, Noise, FloatArray]:
    """Who each measurement came from (m,), the noise, and how probably it is that one's noise (m,)."""
    targets = recording.targets.shape[2]
    noise, owner = None, None
    for _ in range(_ROUNDS):
        sigmas, biases = (gate / 4.0, np.zeros_like(gate)) if noise is None else (noise.sigmas, noise.biases)
        again = associate(recording, seen, sigmas, biases, gate)
        if owner is not None and (again == owner).all():
            break
        owner = again
        rows = np.flatnonzero((owner >= 0) & (owner < targets))
        errors = errors_at(recording, seen, owner, rows)
        noise = fit_noise(errors, gate)
    assert noise is not None
    assert owner is not None
    share = np.zeros(len(owner))
    share[rows] = responsibilities(noise, errors, gate)
    return owner, noise, share
