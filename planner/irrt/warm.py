"""The kernels of this package once, with tiny data of run-time types."""

import numpy as np

from estimator.exploration import Exploration
from estimator.filter import Area
from estimator.sensors.range_bearing import RangeBearing
from planner.irrt.irrt import Irrt
from planner.irrt.mdp_greedy import MdpGreedy
from planner.plan import Intensity, PlannerSetup, PlanProblem
from planner.vehicles.unicycle import Unicycle


def warm_irrt() -> None:
    """Two plans of the tree, the second with the first's tree, and one of the greedy MDP."""
    for d in (2, 3):
        area = Area(np.zeros(d), np.full(d, 10.0))
        config = RangeBearing.Config(
            period_s=1.0,
            range_sigma_m=1.0,
            bearing_sigma_deg=1.0,
            elevation_sigma_deg=1.0 if d == 3 else None,
            reach_m=[5.0] * d,
        )
        vehicle = Unicycle(Unicycle.Config(speed_m_s=1.0))
        setup = PlannerSetup({"a": vehicle}, {"a": RangeBearing.of(config, area)}, area)
        place = np.full((d, 1), 7.0)
        problem = PlanProblem(
            robot="a",
            state=vehicle.initial_state(np.array([1.0, 1.0, 0.0, 0.0])),
            start_time=0.0,
            measure_period=1.0,
            clusters=place,
            exploration=Exploration.unexplored(area, [3] * d),
            others=(),
            area=area,
            intensity=Intensity(place, np.ones(1), place, np.eye(d)[None], np.ones(1)),
        )
        tree = Irrt(Irrt.Config(nodes=40), setup)
        tree.plan(problem)
        tree.plan(problem)
        MdpGreedy(MdpGreedy.Config(cells=[3] * d), setup).plan(problem)
