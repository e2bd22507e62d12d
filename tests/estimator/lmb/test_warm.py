"""After the warm-up no mission with an LMB filter waits for a compiler."""

import subprocess
import sys

RUN = """
import importlib, pkgutil
import numpy as np
from numba.core.registry import CPUDispatcher
import estimator
from estimator.filter import Area
from estimator.lmb.lmb import Lmb
from estimator.motion import MotionConfig
from estimator.search import Search
from estimator.sensors.range_bearing import RangeBearing
from estimator.sensors.teammates import Teammates
from estimator.warm import warmups

for name, call in warmups():
    if "LMB" in name or "field of view" in name:
        call()
names = [m.name for m in pkgutil.walk_packages(estimator.__path__, "estimator.")]
modules = [importlib.import_module(name) for name in names]
found = [(f"{m.__name__}.{k}", v) for m in modules for k, v in vars(m).items()]
kernels = {name: value for name, value in found if isinstance(value, CPUDispatcher)}
warm = {name: set(kernel.signatures) for name, kernel in kernels.items()}
for d in (2, 3):
    for moving in (False, True):
        area, rng = Area(np.zeros(d), np.full(d, 60.0)), np.random.default_rng(0)
        config = dict(period_s=1.0, range_sigma_m=0.3, bearing_sigma_deg=0.5, reach_m=[60.0] * d, clutter=2.0)
        config["elevation_sigma_deg"] = 0.5 if d == 3 else None
        sensor = RangeBearing.of(RangeBearing.Config(**config), area)
        motion = MotionConfig(kind="constant_velocity" if moving else "static")
        filter = Lmb(Lmb.Config(motion=motion, spacing_m=0.2, exact_groups=0 if moving else 5))
        mates = Teammates({"a": np.zeros(4), "b": np.full(4, 10.0)}, 0.1, 1.0)
        keys = dict(radius=1.0, mass=0.9, gate=4.0, remove=not moving, teammates=mates)
        team = Search(filter, area, [5] * d, **keys)
        state, targets = team.init(rng), rng.uniform(20, 40, (d, 6))
        targets[:, 1] = targets[:, 0] + 0.3
        for k in range(20):
            pose = np.append(rng.uniform(0, 60, 3), 0.0)
            z = sensor.sample(targets, pose, rng)
            state = team.apply(state, sensor, pose, z, float(k), rng, "ab"[k % 2])
        team.thinned(state, 10)
for name, kernel in kernels.items():
    if ".lmb." in name or ".gaussian." in name:
        for signature in set(kernel.signatures) - warm[name]:
            print(name, signature)
"""


def test_after_the_warm_up_a_search_with_lmb_needs_no_other_kernel() -> None:
    run = subprocess.run([sys.executable, "-c", RUN], check=True, timeout=110, capture_output=True, text=True)
    assert run.stdout == ""
