"""Do the virtual-time driver and the process driver agree on a mission's outcome?

`python -m benchmarks.agreement MISSION --seeds 0:10 --speed 3` runs every seed in both and compares the
distributions of time and measurement sets to all found (two-sample Kolmogorov-Smirnov and Mann-Whitney),
targets found and RMSE. The drivers cannot agree seed by seed: which robot plans first is up to the machine.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import ks_2samp, mannwhitneyu

from agents.mission.mission_file import load
from sim.simulate.simulate import parse_seeds, run_all

MEASURES = ("time_to_all_found_s", "measurements_to_all_found", "rmse_m")


def in_processes(mission: str, seed: int, speed: float) -> dict[str, Any]:
    """The summary of one run of real processes."""
    with tempfile.TemporaryDirectory() as directory:
        out = Path(directory) / "run"
        words = [
            "swarm",
            mission,
            "--seed",
            str(seed),
            "--speed",
            str(speed),
            "--view",
            "none",
            "--out",
            str(out),
        ]
        subprocess.run([sys.executable, "-m", "agents.cli", *words], check=False, capture_output=True)
        summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
        return summary


def main() -> None:
    """Run, compare, print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission")
    parser.add_argument("--seeds", default="0:10")
    parser.add_argument("--speed", type=float, default=3.0)
    arguments = parser.parse_args()
    seeds = parse_seeds(arguments.seeds)
    virtual = run_all(load(arguments.mission), seeds, 1, None)
    processes = [in_processes(arguments.mission, seed, arguments.speed) for seed in seeds]
    found = [sum(r["all_found"] for r in runs) for runs in (virtual, processes)]
    false = [sum(r["false_found"] for r in runs) for runs in (virtual, processes)]
    print(f"{arguments.mission}, {len(seeds)} seeds.")
    print(f"Runs that found all: virtual {found[0]}, processes {found[1]}.")
    print(f"False targets: {false[0]} and {false[1]}.\n")
    print("| | virtual, mean ± sd | processes, mean ± sd | KS p | Mann-Whitney p |")
    print("| --- | --- | --- | --- | --- |")
    for name in MEASURES:
        a, b = (np.array([r[name] for r in runs if r[name] is not None]) for runs in (virtual, processes))
        cells = [f"{x.mean():.2f} ± {x.std(ddof=1):.2f}" for x in (a, b)]
        print(
            f"| {name} | {' | '.join(cells)} "
            f"| {ks_2samp(a, b).pvalue:.2f} | {mannwhitneyu(a, b).pvalue:.2f} |"
        )


if __name__ == "__main__":
    main()
