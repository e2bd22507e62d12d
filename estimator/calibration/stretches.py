"""A recording cut into stretches, and what follows from them: the estimates, and how far they scatter."""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import BoolArray, FloatArray, IntArray
from estimator.calibration.association import errors_at
from estimator.calibration.clutter import find_peaks, fit_symmetric_peaks, poisson_interval
from estimator.calibration.detection import DEGREE, fit_opening, fit_table, hats
from estimator.calibration.noise import Noise, fit_noise
from estimator.calibration.recording import Geometry, Recording, behind
from estimator.calibration.resampling import blocks, interval, intervals
from estimator.calibration.result import Calibration, Options
from estimator.sensors.range_bearing import wrapped

_BINS = 60  # over the range, in which the table is fitted
_SECTORS = 9  # of the opening, whose p_D is compared with the table's


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """A recording's sums by stretch, from which the estimates of any resampled recording follow."""

    recording: Recording
    options: Options
    gate: FloatArray
    count: int  # of stretches
    errors: FloatArray  # (k, s) of sightings
    rows: IntArray  # (k,) the stretch of each
    seen: tuple[float, float]  # nearest and farthest
    opening: tuple[float, float]
    by_bearing: FloatArray  # (2, count, 360) trials and hits by degree
    by_range: FloatArray  # (2, count, _BINS) those well within the opening
    basis: FloatArray  # (_BINS, b)
    breaks: FloatArray
    by_sector: FloatArray  # (2, count, _SECTORS) expected by the table, and hits
    clutter: FloatArray  # (count, 360) by degree off the heading
    sets: FloatArray  # (count,)
    trials: int

    @staticmethod
    def of(
        recording: Recording,
        seen: Geometry,
        owner: IntArray,
        share: FloatArray,
        gate: FloatArray,
        options: Options,
    ) -> "Stretches":
        """Count, given who each measurement came from (m,) and how probably that is its noise (m,).

        Raises:
            ValueError: if hardly any target was seen.
        """
        f, n = len(recording.poses), recording.targets.shape[2]
        stretch = blocks(f, options.stretches)
        count = int(stretch[-1]) + 1
        rows = np.flatnonzero((owner >= 0) & (owner < n))
        frames = recording.frames
        hits = np.zeros((f, n))
        hits[frames[rows], owner[rows]] = share[rows]
        tried = _in_sight(recording, seen, options) | (hits > 0.0)
        ranges, bearings = np.where(tried, seen.ranges[:, :n], np.nan), seen.bearings[:, :n]
        sighted = ranges[hits > 0.5]
        if sighted.size < 10:
            raise ValueError(
                f"measurements: {sighted.size} sightings of targets are too few to calibrate with"
            )
        near, far = float(sighted.min()), float(sighted.max())
        tried &= (ranges >= near) & (ranges <= far)
        at = np.nonzero(tried)
        r, b, hit, where = ranges[at], bearings[at], hits[at], stretch[at[0]]
        by_bearing = _sums(where, _degree(b), hit, count, 360)
        opening = fit_opening(*by_bearing.sum(axis=1))
        inner = _well_within(b, opening)
        bins = np.minimum(((r - near) / (far - near + 1e-12) * _BINS).astype(np.int64), _BINS - 1)
        by_range = _sums(where[inner], bins[inner], hit[inner], count, _BINS)
        breaks = np.array(options.breaks or np.linspace(near, far, 8))
        middles = near + (np.arange(_BINS) + 0.5) * (far - near) / _BINS
        basis = hats(middles, breaks)
        tries, successes = by_range.sum(axis=1)
        gains = np.nan_to_num(fit_table(tries, successes, basis))
        width = opening[1] - opening[0]
        part = ((b - opening[0]) / width * _SECTORS).astype(np.int64)
        open_ = (b >= opening[0]) & (b < opening[1])
        hoped = (hats(r, breaks) @ gains)[open_]
        by_sector = _sums(where[open_], part[open_], hit[open_], count, _SECTORS, hoped)
        false = 1.0 - share
        false[owner >= n] = 0.0
        turned = _headings_off(recording)
        clutter = np.zeros((count, 360))
        np.add.at(clutter, (stretch[frames], _degree(turned)), false)
        return Stretches(
            recording,
            options,
            gate,
            count,
            errors_at(recording, seen, owner, rows),
            stretch[frames[rows]],
            (near, far),
            opening,
            by_bearing,
            by_range,
            basis,
            breaks,
            by_sector,
            clutter,
            np.bincount(stretch, minlength=count).astype(np.float64),
            int(by_range[0].sum()),
        )

    def estimates(self, weights: FloatArray, noise: Noise, start: Noise | None) -> dict[str, FloatArray]:
        """Each parameter (d, k) of d recordings in which the stretches count weights (d, count) times."""
        d = len(weights)
        s = len(self.gate)
        noises = np.full((d, 2 * s + 1), np.nan)
        for i, w in enumerate(weights):
            fit = noise if start is None else fit_noise(self.errors, self.gate, w[self.rows], start, 10)
            noises[i] = [*fit.sigmas, *fit.biases, 1.0 - fit.inliers]
        tries, successes = weights @ self.by_range[0], weights @ self.by_range[1]
        trials, hits = (weights @ part for part in self.by_bearing)
        opening = np.array([fit_opening(*pair, self.opening) for pair in zip(trials, hits, strict=True)])
        expected, sector_hits = (weights @ part for part in self.by_sector)
        clutter = weights @ self.clutter
        width = self.opening[1] - self.opening[0]
        peaks = np.tile([1.0, np.nan], (d, 1))
        if self.recording.quantities == ("bearing",):  # only such sensors have a model with these peaks
            peaks = np.array([fit_symmetric_peaks(row, width) for row in clutter])
        with np.errstate(invalid="ignore", divide="ignore"):
            sectors = np.where(expected > 1.0, sector_hits / expected, np.nan)
        return {
            "sigmas": noises[:, :s],
            "biases": noises[:, s : 2 * s],
            "outliers": noises[:, -1:],
            "opening": opening,
            "gains": fit_table(tries, successes, self.basis),
            "sector_gains": sectors,
            "clutter": (clutter.sum(axis=1) / (weights @ self.sets))[:, None],
            "clutter_uniform": peaks[:, :1],
            "clutter_peak": peaks[:, 1:],
        }

    def calibration(
        self, main: dict[str, FloatArray], draws: dict[str, FloatArray], noise: Noise
    ) -> Calibration:
        """The estimates together with their intervals."""
        found = {name: intervals(values) for name, values in draws.items()}
        total = float(self.clutter.sum())
        exact = poisson_interval(total, float(self.sets.sum()))
        spread = interval(draws["clutter"][:, 0])
        found["clutter"] = [(min(exact[0], spread[0]), max(exact[1], spread[1]))]
        found["opening"] = [(low - DEGREE / 2, high + DEGREE / 2) for low, high in found["opening"]]
        quantities = self.recording.quantities
        edges, width = np.linspace(*self.opening, _SECTORS + 1), self.opening[1] - self.opening[0]
        z, off = self.recording.measurements, np.abs(_headings_off(self.recording))
        farthest = float(z[:, quantities.index("range")].max()) if "range" in quantities else np.nan
        uniform, peak = main["clutter_uniform"][0, 0], main["clutter_peak"][0, 0]
        return Calibration(
            quantities=quantities,
            sigmas=dict(zip(quantities, noise.sigmas.tolist(), strict=True)),
            biases=dict(zip(quantities, noise.biases.tolist(), strict=True)),
            outliers=1.0 - noise.inliers,
            nearest=self.seen[0],
            farthest=self.seen[1],
            opening=self.opening,
            breaks=self.breaks,
            gains=main["gains"][0],
            sectors=0.5 * (edges[:-1] + edges[1:]),
            sector_gains=main["sector_gains"][0],
            clutter=float(main["clutter"][0, 0]),
            peaks=find_peaks(self.clutter.sum(axis=0), width) if "bearing" in quantities else (),
            clutter_uniform=float(uniform),
            clutter_peak=float(peak),
            sets=int(self.sets.sum()),
            sightings=len(self.errors),
            trials=self.trials,
            measured=(farthest, float(off.max()) if "bearing" in quantities else np.nan),
            intervals=found,
        )


def _in_sight(recording: Recording, seen: Geometry, options: Options) -> BoolArray:
    """(f, n) targets that were there and nothing hid."""
    n = recording.targets.shape[2]
    there = np.isfinite(seen.ranges[:, :n])
    if recording.hidden is not None:
        there &= ~recording.hidden
    if options.bystander_radius > 0.0:
        there &= ~behind(seen, n, options.bystander_radius)
    return there


def _headings_off(recording: Recording) -> FloatArray:
    """(m,) bearings from the heading; 0 of a sensor that measures none."""
    if "bearing" not in recording.quantities:
        return np.zeros(len(recording.measurements))
    bearings = recording.measurements[:, recording.quantities.index("bearing")]
    return wrapped(bearings - (0.0 if recording.body_frame else recording.poses[recording.frames, 3]))


def _well_within(bearings: FloatArray, opening: tuple[float, float]) -> BoolArray:
    """Away from the edges, which noise blurs."""
    low, high = opening
    if high - low > 2 * np.pi - 1e-9:
        return np.ones(bearings.shape, dtype=np.bool_)
    margin = min(3.0 * DEGREE, 0.1 * (high - low))
    return (bearings > low + margin) & (bearings < high - margin)


def _degree(bearings: FloatArray) -> IntArray:
    return np.clip(np.floor(np.degrees(bearings)).astype(np.int64) + 180, 0, 359)


def _sums(
    stretch: IntArray,
    column: IntArray,
    hits: FloatArray,
    count: int,
    columns: int,
    trials: FloatArray | None = None,
) -> FloatArray:
    """(2, count, columns) sums of trials (1 each by default) and of hits."""
    out = np.zeros((2, count, columns))
    np.add.at(out[0], (stretch, column), 1.0 if trials is None else trials)
    np.add.at(out[1], (stretch, column), hits)
    return out
