"""The kernel cache."""

import subprocess
import sys

from estimator.warm import warmups


def test_every_call_has_a_name_of_its_own_and_runs() -> None:
    names = [name for name, _ in warmups()]
    assert len(set(names)) == len(names)
    for _, call in warmups():
        call()


RUN = """
import importlib, pkgutil
import numpy as np
from numba.core.registry import CPUDispatcher
import estimator
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from estimator.search import Search
from estimator.smc.smc_phd import SmcPhd
from estimator.warm import warmups

modules = [importlib.import_module("estimator." + m.name) for m in pkgutil.iter_modules(estimator.__path__)]
kernels = {k: v for m in modules for k, v in vars(m).items() if isinstance(v, CPUDispatcher)}
for _, call in warmups():
    call()
warm = {name: set(kernel.signatures) for name, kernel in kernels.items()}
for d in (2, 3):
    area, rng = Area(np.zeros(d), np.full(d, 60.0)), np.random.default_rng(0)
    config = dict(period_s=1.0, range_sigma_m=0.3, bearing_sigma_deg=0.5, reach_m=[30.0] * d, clutter=0.3)
    sensor = RangeBearing.of(RangeBearing.Config(**config, elevation_sigma_deg=0.5 if d == 3 else None), area)
    team = Search(SmcPhd(SmcPhd.Config(particles=500)), area, [5] * d, radius=1.0, mass=0.8, gate=4.0)
    state, targets = team.init(rng), rng.uniform(0, 60, (d, 3))
    for k in range(30):
        pose = np.append(rng.uniform(0, 60, 3), 0.0)
        state = team.apply(state, sensor, pose, sensor.sample(targets, pose, rng), float(k), rng)
    team.thinned(state, 10)
    state.exploration.at(targets)
for name, kernel in kernels.items():
    for signature in set(kernel.signatures) - warm[name]:
        print(name, signature)
"""


def test_after_the_warm_up_a_search_needs_no_other_kernel() -> None:
    run = subprocess.run([sys.executable, "-c", RUN], check=True, timeout=110, capture_output=True, text=True)
    assert run.stdout == ""
