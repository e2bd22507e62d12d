"""The kernel cache of the sensors; tests/estimator/test_warm.py looks after range_bearing."""

import subprocess
import sys

RUN = """
import importlib, pkgutil
import numpy as np
from numba.core.registry import CPUDispatcher
import estimator.sensors as room
from estimator.search import Search
from estimator.sensors import warm
from estimator.smc.smc_phd import SmcPhd
from tests.estimator.sensors.cases import NAMES, POSE, area, case

names = ["estimator.sensors." + m.name for m in pkgutil.iter_modules(room.__path__)]
modules = [importlib.import_module(name) for name in names]
ours = [m for m in modules if m.__name__.split(".")[-1] not in ("gating", "range_bearing")]
kernels = {
    f"{m.__name__}.{k}": v for m in ours for k, v in vars(m).items()
    if isinstance(v, CPUDispatcher) and v.py_func.__module__ == m.__name__
}
for kind in warm.KINDS:
    for d in (2, 3):
        warm.run(kind, d)
ready = {name: set(kernel.signatures) for name, kernel in kernels.items()}
for d in (2, 3):
    for name in NAMES:
        sensor, rng = case(name, d).sensor, np.random.default_rng(0)
        team = Search(SmcPhd(SmcPhd.Config(particles=300)), area(d), [5] * d, radius=1.0, mass=0.8, gate=1.0)
        state, targets = team.init(rng), rng.uniform(8, 16, (d, 3))
        for k in range(4):
            state = team.apply(state, sensor, POSE, sensor.sample(targets, POSE, rng), float(k), rng)
        if hasattr(sensor, "jacobian"):
            sensor.jacobian(targets, POSE)
for name, kernel in kernels.items():
    for signature in set(kernel.signatures) - ready[name]:
        print(name, signature)
"""


def test_after_the_warm_up_no_sensor_needs_a_compiler() -> None:
    run = subprocess.run(
        [sys.executable, "-c", RUN], check=False, timeout=110, capture_output=True, text=True
    )
    assert (run.stdout, run.returncode) == ("", 0), run.stderr
