"""What a tree of ways must know of a vehicle, found out by asking the vehicle's own model.

Any vehicle model can be asked where it goes when sent ahead, behind and up. How long a turn takes and how far
aside it leads tells a drone, which turns at no cost, from a ground robot, which turns on the spot, and from a
fixed-wing aircraft, which cannot. So vehicles from other packages need not say anything about themselves.
"""

from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from planner.plan import VehicleModel

FREE, ON_THE_SPOT, FORWARD = 0, 1, 2
LEG_S = 30.0  # what a long way takes, about
LOOK_S = 0.25  # between poses that are looked at
CLIMB = 0.3  # metres up for each metre ahead, where a vehicle that turns can climb at all


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Speed and turning of a vehicle on its way."""

    mode: int  # FREE: any direction at once; ON_THE_SPOT: turns standing; FORWARD: turns only flying
    speed: float  # m/s
    turn_rate: float  # rad/s; not used where FREE
    heads: bool  # whether its yaw is where it goes
    climb: float  # metres up for each metre ahead that it can do

    @property
    def turn_radius(self) -> float:
        """Metres, of its narrowest circle at speed; 0 where it turns at no cost or on the spot."""
        return self.speed / self.turn_rate if self.mode == FORWARD else 0.0


def identified(vehicle: VehicleModel, state: FloatArray, scale: float) -> Kinematics:
    """The kinematics of a vehicle from its predictions at the place and altitude of `state`.

    Args:
        vehicle: asked for predictions from `state`, at rest or cruising as its initial state is.
        state: of which only the pose is used.
        scale: metres of the ways looked at, for instance a side of the area.
    """
    pose = vehicle.pose(state).copy()
    pose[3] = 0.0
    start = vehicle.initial_state(pose)
    here = pose[:3]
    offsets = scale * np.array([[1, 0, 0], [2, 0, 0], [-2, 0, 0], [0, 2, 0], [2, 0, 0.2]], np.float64)
    ways = vehicle.predict(start, here + offsets, LOOK_S)
    seconds = ways.steps * vehicle.control_period
    ahead = float(seconds[1] - seconds[0])
    speed = scale / ahead if ahead > 0 else scale / max(float(seconds[0]), 1e-3)
    back = ways.measure_poses[ways.offsets[2] : ways.offsets[3]]
    side = vehicle.pose(ways.end_states[3])
    heads = bool(abs(side[3]) > 0.5)
    aside = float(np.abs(back[:, 1] - here[1]).max(initial=0.0))
    detour = max(float(seconds[2] - seconds[1]), 0.0)
    climbs = abs(vehicle.pose(ways.end_states[4])[2] - here[2]) > 0.1 * scale
    if not heads:
        return Kinematics(FREE, speed, np.inf, False, np.inf if climbs else 0.0)
    climb = CLIMB if climbs else 0.0
    stands = not vehicle.velocity(start).any()  # what can rest may swing aside, but it turns on the spot
    if not stands and aside > 0.5 * speed * LOOK_S and aside > 0.02 * scale:  # two radii in half a turn
        return Kinematics(FORWARD, speed, 2.0 * speed / aside, True, climb)
    if detour < LOOK_S:
        return Kinematics(FREE, speed, np.inf, True, np.inf if climbs else 0.0)
    return Kinematics(ON_THE_SPOT, speed, np.pi / detour, True, climb)
