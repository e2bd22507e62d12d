"""The ways to all candidates at once: straight, or around what the ground has in between."""

import numpy as np

from estimator.arrays import FloatArray
from planner.ground.routes import around, lifted
from planner.plan import Over, PlannerSetup, PlanProblem, Predictions, never


def ways(
    problem: PlanProblem, setup: PlannerSetup, waypoints: FloatArray, period: float, over: Over = never
) -> Predictions:
    """`VehicleModel.predict` with the ways of waypoints (w, 3) that are not clear led around obstacles.

    A waypoint to which there is no way, or none was found before time was `over`, has no steps and no
    measurements, as one that the robot stands on.
    Ways around are estimates to choose by (`planner.ground.routes.around`); a plan predicts the chosen one.
    """
    vehicle = setup.vehicles[problem.robot]
    direct = vehicle.predict(problem.state, waypoints, period)
    if setup.ground is None or not len(waypoints):
        return direct
    led = around(lifted(setup.ground, problem.area.dimension), vehicle, problem.state, direct, period, over)
    if led.open.all():
        return led.ways
    way = led.ways
    kept = np.repeat(led.open, np.diff(way.offsets))
    counts = np.where(led.open, np.diff(way.offsets), 0)
    ends = np.where(led.open[:, None], way.end_states, np.asarray(problem.state, dtype=np.float64))
    return Predictions(
        waypoints=waypoints,
        steps=np.where(led.open, way.steps, 0),
        control_costs=np.where(led.open, way.control_costs, 0.0),
        offsets=np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts)]),
        measure_times=way.measure_times[kept],
        measure_poses=way.measure_poses[kept],
        end_states=ends,
    )
