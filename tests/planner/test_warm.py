import os
import subprocess
import sys

from planner.vehicles import quadrotor_flight, unicycle
from planner.warm import warmups

CHECK = """
import numpy as np
from tests.planner.problems import committed, problem, team
from planner.warm import warmups
for _, call in warmups():
    call()
from planner import separation
from planner.maasi import coupling, coverage
from planner.vehicles import quadrotor_flight, unicycle
from estimator.sensors import field_of_view
kernels = [
    k for m in (coupling, coverage, quadrotor_flight, separation, unicycle, field_of_view)
    for k in vars(m).values() if hasattr(k, "signatures")
]
before = [len(k.signatures) for k in kernels]
from estimator.exploration import Exploration
from estimator.sensors.range_bearing import RangeBearing
from planner.maasi.maasi_joint import MaasiJoint
from planner.plan import PlannerSetup
for d in (2, 3):
    setup = team(d)
    config = RangeBearing.Config(
        period_s=1.0, range_sigma_m=1.0, bearing_sigma_deg=1.0,
        elevation_sigma_deg=1.0 if d == 3 else None, reach_m=[5.0] * d,
    )
    sensor = RangeBearing.of(config, setup.area)
    setup = PlannerSetup(setup.vehicles, {"a": sensor, "b": sensor}, setup.area)
    planner = MaasiJoint(MaasiJoint.Config(), setup)
    a, b = problem(setup, 0, "a", separation=1.0), problem(setup, 1, "b", separation=1.0)
    plans = planner.plan_jointly((a, b))
    other = problem(setup, 0, "a", others=[committed(plans[1].trajectory)], separation=1.0)
    assert planner.plan(other).trajectory is not None
late = [k.__name__ for k, n in zip(kernels, before) if len(k.signatures) != n]
assert not late, f"compiled in flight: {late}"
"""


def test_after_the_warm_up_nothing_is_compiled_in_flight():
    done = subprocess.run(
        [sys.executable, "-c", CHECK],
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_warm_ups_have_names_and_run():
    for name, call in warmups():
        assert name
        call()
    assert quadrotor_flight.predict.signatures  # type: ignore[attr-defined]
    assert unicycle._predict.signatures  # type: ignore[attr-defined]
