"""A team's robots see each other, and sensors do not tell them from targets.

Where each robot was is known from the measurement sets themselves: every set carries its robot's pose. So in
every set the other robots are known objects (`estimator.sensors.known`), each at the pose of its last set.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimator.arrays import FloatArray
from estimator.sensor import SensorModel
from estimator.sensors.known import with_known

Poses = Mapping[str, FloatArray]  # by robot, (4,)


@dataclass(frozen=True, slots=True, eq=False)
class Teammates:
    """What sensors see of the other robots: `rate` measurements per set, `spread` m around each pose.

    The rate should be a few times p_D: a robot that stands still is seen a hundred times, and its place must
    stay the better explanation of all these sightings although the spread blurs it.
    """

    starts: Poses  # before a robot's first set
    spread: float
    rate: float

    def expected_by(self, robot: str, sensor: SensorModel, poses: Poses) -> SensorModel:
        """The sensor of one robot, that expects to see the others at their poses."""
        others = [pose[: sensor.dimension] for name, pose in sorted(poses.items()) if name != robot]
        if not others or self.rate == 0.0:
            return sensor
        count = len(others)
        return with_known(
            sensor, np.stack(others, axis=1), np.full(count, self.spread), np.full(count, self.rate)
        )
