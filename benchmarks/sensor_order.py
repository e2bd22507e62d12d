"""How much does the order of the sensors matter to the iterated corrector?

`python -m benchmarks.sensor_order` applies the sets of four sensors of one time in all 24 orders, with
Gaussian components and with particles, and once all together (`update_together`), and prints the table of
docs/gm_phd.md. Twelve targets that were found before with mass 0.9 each, and an undetected mass of 3 (GM).
Figures are means over seeds.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.gaussian.gm_phd import GmPhd
from estimator.multisensor import Take, jointly_corrected
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.correction import corrected

Figures = dict[str, float]

AREA = Area(np.zeros(2), np.full(2, 100.0))
POSES = [np.array([x, y, 0.0, 0.0]) for x, y in ((30.0, 30.0), (70.0, 30.0), (70.0, 70.0), (30.0, 70.0))]
CASES = {
    "p_D 0.95, clutter 1": ((0.95,) * 4, 1.0),
    "p_D 0.7, clutter 1": ((0.7,) * 4, 1.0),
    "p_D 0.7, clutter 10": ((0.7,) * 4, 10.0),
    "p_D 0.3, 0.5, 0.7, 0.95, clutter 1": ((0.3, 0.5, 0.7, 0.95), 1.0),
    "p_D 0.3, 0.5, 0.7, 0.95, clutter 10": ((0.3, 0.5, 0.7, 0.95), 10.0),
}


def takes(
    gains: tuple[float, ...], clutter: float, targets: FloatArray, rng: np.random.Generator
) -> list[Take]:
    """One set of each sensor."""
    made = []
    for gain, pose in zip(gains, POSES, strict=True):
        table = RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=0.5,
            bearing_sigma_deg=0.5,
            gain=gain,
            clutter=clutter,
            field_of_view="box",
            box_m=[(-200.0, 200.0)] * 2,
        )
        model = RangeBearing.of(table, AREA)
        made.append(Take(model, pose, model.sample(targets, pose, rng)))
    return made


class Gaussians:
    """The GM-PHD filter, with a uniform undetected mass of 3."""

    def __init__(self, targets: FloatArray, rng: np.random.Generator) -> None:
        k = targets.shape[1]
        means = targets.T + 0.4 * rng.standard_normal((k, 2))
        mixture = Components(np.full(k, 0.9), means, np.tile(0.16 * np.eye(2), (k, 1, 1)))
        self.filter = GmPhd(GmPhd.Config(expected_targets=3.0, components=5000))
        start = self.filter.init(AREA, rng)
        self.start = replace(start, components=mixture, labels=np.full(k, -1))
        self.rng = rng  # the filter draws nothing

    def in_turn(self, takes: Sequence[Take]) -> tuple[FloatArray, FloatArray, float]:
        """Points (2, n), weights (n,) and mass after one sensor after another."""
        state = self.start
        for take in takes:
            state = self.filter.update(state, take.sensor, take.pose, take.measurements, self.rng)
        return state.components.means.T, state.components.weights, self.filter.mass(state)

    def together(self, takes: Sequence[Take]) -> tuple[FloatArray, FloatArray, float]:
        """The same after all at once."""
        state = self.filter.update_together(self.start, takes)
        return state.components.means.T, state.components.weights, self.filter.mass(state)


class Particles:
    """The particle corrector, 250 for each target, nothing undetected: no draws blur the comparison."""

    def __init__(self, targets: FloatArray, rng: np.random.Generator) -> None:
        k, each = targets.shape[1], 250
        means = targets + 0.4 * rng.standard_normal((2, k))
        self.x = np.repeat(means, each, axis=1) + 0.4 * rng.standard_normal((2, k * each))
        self.w = np.full(k * each, 0.9 / each)

    def in_turn(self, takes: Sequence[Take]) -> tuple[FloatArray, FloatArray, float]:
        """As `Gaussians.in_turn`."""
        w = self.w
        for take in takes:
            w = corrected(w, take.sensor.look(self.x, take.pose, take.measurements))
        return self.x, w, float(w.sum())

    def together(self, takes: Sequence[Take]) -> tuple[FloatArray, FloatArray, float]:
        """As `Gaussians.together`."""
        looks = [take.sensor.look(self.x, take.pose, take.measurements) for take in takes]
        w = jointly_corrected(self.w, looks)
        return self.x, w, float(w.sum())


def one(
    kind: type[Gaussians] | type[Particles], gains: tuple[float, ...], clutter: float, seed: int
) -> Figures:
    """The figures of one seed."""
    rng = np.random.default_rng(seed)
    targets = rng.uniform(10.0, 90.0, (2, 12))
    made, given = kind(targets, rng), takes(gains, clutter, targets, rng)

    def near(x: FloatArray, w: FloatArray) -> FloatArray:
        """Mass within 2 m of each target."""
        return np.asarray(w @ (np.linalg.norm(x[:, :, None] - targets[:, None, :], axis=0) < 2.0))

    began = time.perf_counter()
    orders = [made.in_turn([given[s] for s in order]) for order in permutations(range(4))]
    iterated = (time.perf_counter() - began) / 24
    began = time.perf_counter()
    x, w, mass = made.together(given)
    joint = time.perf_counter() - began
    each = np.array([near(x, w) for x, w, _ in orders])
    return {
        "least": min(m for _, _, m in orders),
        "most": max(m for _, _, m in orders),
        "joint": mass,
        "apart": float((each.max(axis=0) - each.min(axis=0)).max()),
        "wrong": float(np.abs(each - 1.0).mean()),
        "joint_wrong": float(np.abs(near(x, w) - 1.0).mean()),
        "iterated_ms": 1e3 * iterated,
        "joint_ms": 1e3 * joint,
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    arguments = parser.parse_args()
    print(
        "| sensors | filter | cardinality, least to most of 24 orders | together | largest change of a "
        "target's mass | mean error of a target's mass: iterated, together | ms: iterated, together |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, (gains, clutter) in CASES.items():
        for short, kind in (("GM", Gaussians), ("SMC", Particles)):
            one(kind, gains, clutter, 0)  # compiles
            runs = [one(kind, gains, clutter, seed) for seed in range(arguments.seeds)]
            f = {key: float(np.mean([run[key] for run in runs])) for key in runs[0]}
            print(
                f"| {name} | {short} | {f['least']:.2f} to {f['most']:.2f} | {f['joint']:.2f} | "
                f"{f['apart']:.3f} | {f['wrong']:.3f}, {f['joint_wrong']:.3f} | "
                f"{f['iterated_ms']:.1f}, {f['joint_ms']:.1f} |"
            )


if __name__ == "__main__":
    main()
