"""How much does the order of the sensors matter to the iterated corrector?

`python -m benchmarks.sensor_order` applies the sets of four sensors of one time in all 24 orders, with
Gaussian components and with particles, and once all together (`update_together`), and prints the table of
docs/gm_phd.md. Twelve targets that were found before with mass 0.9 each, uniform undetected mass 3; figures
are means over seeds.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np

from estimator.arrays import FloatArray
from estimator.filter import Area
from estimator.gaussian.components import Components
from estimator.gaussian.gm_phd import GmPhd
from estimator.multisensor import Take
from estimator.sensors.range_bearing import RangeBearing
from estimator.smc.multisensor import updated_together
from estimator.smc.smc_phd import SmcPhd

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


def gaussian(targets: FloatArray, rng: np.random.Generator) -> tuple[Any, Any, Callable[[Any], Any]]:
    """A GM-PHD filter, a state about the targets, and what a state's points are."""
    filter = GmPhd(GmPhd.Config(expected_targets=3.0, components=5000))
    k = targets.shape[1]
    means = targets.T + 0.4 * rng.standard_normal((k, 2))
    state = filter.init(AREA, rng)
    mixture = Components(np.full(k, 0.9), means, np.tile(0.16 * np.eye(2), (k, 1, 1)))
    return (
        filter,
        replace(state, components=mixture, labels=np.full(k, -1)),
        lambda s: (s.components.means.T, s.components.weights),
    )


def particles(targets: FloatArray, rng: np.random.Generator) -> tuple[Any, Any, Callable[[Any], Any]]:
    """As `gaussian`, with particles."""
    filter = SmcPhd(SmcPhd.Config(expected_targets=3.0, particles=10_000_000, jitter=0.0))
    k, each = targets.shape[1], 250
    means = targets + 0.4 * rng.standard_normal((2, k))
    x = np.repeat(means, each, axis=1) + 0.4 * rng.standard_normal((2, k * each))
    state = replace(
        filter.init(AREA, rng),
        states=x,
        weights=np.full(k * each, 0.9 / each),
        labels=np.full(k * each, -1),
    )
    return filter, state, lambda s: (s.positions, s.weights)


def one(make: Any, gains: tuple[float, ...], clutter: float, seed: int) -> dict[str, float]:
    """The figures of one seed."""
    rng = np.random.default_rng(seed)
    targets = rng.uniform(10.0, 90.0, (2, 12))
    filter, state, points = make(targets, rng)
    given = takes(gains, clutter, targets, rng)

    def near(state: Any) -> FloatArray:
        """Mass within 2 m of each target."""
        x, w = points(state)
        close = np.linalg.norm(x[:, :, None] - targets[:, None, :], axis=0) < 2.0
        return np.asarray(w @ close)

    masses, targets_masses, began = [], [], time.perf_counter()
    for order in permutations(range(4)):
        after, draws = state, np.random.default_rng(1)
        for s in order:
            after = filter.update(after, given[s].sensor, given[s].pose, given[s].measurements, draws)
        masses.append(filter.mass(after))
        targets_masses.append(near(after))
    iterated = (time.perf_counter() - began) / 24
    began = time.perf_counter()
    if isinstance(filter, GmPhd):
        after = filter.update_together(state, given)
    else:
        after = updated_together(filter, state, given, np.random.default_rng(1))
    joint = time.perf_counter() - began
    each = np.array(targets_masses)
    return {
        "least": min(masses),
        "most": max(masses),
        "joint": filter.mass(after),
        "apart": float((each.max(axis=0) - each.min(axis=0)).max()),
        "wrong": float(np.abs(each - 1.0).mean()),
        "joint_wrong": float(np.abs(near(after) - 1.0).mean()),
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
        for kind, make in (("GM", gaussian), ("SMC", particles)):
            one(make, gains, clutter, 0)
            runs = [one(make, gains, clutter, seed) for seed in range(arguments.seeds)]
            f = {key: float(np.mean([run[key] for run in runs])) for key in runs[0]}
            print(
                f"| {name} | {kind} | {f['least']:.2f} to {f['most']:.2f} | {f['joint']:.2f} | "
                f"{f['apart']:.3f} | {f['wrong']:.3f}, {f['joint_wrong']:.3f} | "
                f"{f['iterated_ms']:.1f}, {f['joint_ms']:.1f} |"
            )


if __name__ == "__main__":
    main()
