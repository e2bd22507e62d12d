"""What MAVLink detectors say that they see, as points around the robot.

Directions are of a level frame that turns with the robot: x ahead, y to the left, z up. A tilting airframe is
not reckoned with: a camera is on a gimbal, or its tilt is part of the noise.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bridges.mavlink.datagrams import Refused
from bridges.mavlink.dialect import Message, mavlink
from estimator.arrays import FloatArray

Mount = Literal["down", "ahead"]
LEVEL_FRAMES = frozenset({8, 12, 20})  # BODY_NED, BODY_FRD and LOCAL_FRD: ahead, to the right, down
ACTIVE = mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
POINT = mavlink.CAMERA_TRACKING_MODE_POINT
STEEPEST = math.radians(89.0)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A direction (3,), of length 1, and how far it is, if that is known."""

    direction: FloatArray
    metres: float | None

    def place(self, pose: FloatArray, dimension: int) -> FloatArray | None:
        """The point (d,) in the team's frame, seen from pose (4,); None: it is not known how far it is.

        Without a distance, what is seen below the robot in a 2D area is on the ground, at z = 0.
        """
        c, s = math.cos(pose[3]), math.sin(pose[3])
        x, y, z = self.direction
        ray = np.array([c * x - s * y, s * x + c * y, z])
        metres = self.metres
        if metres is None:
            if dimension == 3 or ray[2] >= -1e-3 or pose[2] <= 0.0:
                return None
            metres = float(pose[2] / -ray[2])
        return np.asarray((pose[:3] + metres * ray)[:dimension])


def landing_target(message: Message, mount: Mount) -> Sighting:
    """Of a LANDING_TARGET.

    Raises:
        Refused: if it holds numbers that are none, or a frame that nobody can place.
    """
    if message.position_valid:
        if message.frame not in LEVEL_FRAMES:
            entry = mavlink.enums["MAV_FRAME"].get(message.frame)
            name = entry.name if entry else str(message.frame)
            raise Refused("frame", f"a position in {name}; send MAV_FRAME_BODY_FRD, or angles and distance")
        ahead, right, down = message.x, message.y, message.z
        metres = math.hypot(ahead, right, down)
        if not math.isfinite(metres) or metres == 0.0:
            raise Refused("not_finite", "a position that is none")
        return Sighting(np.array([ahead, -right, -down]) / metres, metres)
    if not math.isfinite(message.distance) or message.distance < 0:
        raise Refused("not_finite", "a distance that is none")
    return _seen(_tangent(message.angle_x), _tangent(message.angle_y), mount, message.distance or None)


def tracked(message: Message, mount: Mount, field: tuple[float, float]) -> Sighting | None:
    """Of a CAMERA_TRACKING_IMAGE_STATUS of a camera that sees `field` rad across and up; None: nothing seen.

    Raises:
        Refused: if it holds numbers that are none.
    """
    if message.tracking_status != ACTIVE:
        return None
    if message.tracking_mode == POINT:
        x, y = message.point_x, message.point_y
    else:
        x = (message.rec_top_x + message.rec_bottom_x) / 2
        y = (message.rec_top_y + message.rec_bottom_y) / 2
    if not (math.isfinite(x) and math.isfinite(y) and 0 <= x <= 1 and 0 <= y <= 1):
        raise Refused("not_finite", f"a place in the picture that is none: {x:g}, {y:g}")
    across, up = ((2 * part - 1) * math.tan(angle / 2) for part, angle in zip((x, y), field, strict=True))
    return _seen(across, up, mount, None)


def _tangent(angle: float) -> float:
    if not math.isfinite(angle) or abs(angle) > STEEPEST:
        raise Refused("not_finite", f"an angle of {angle:g} rad")
    return math.tan(angle)


def _seen(right: float, below: float, mount: Mount, metres: float | None) -> Sighting:
    """From tangents to the right and downwards in the picture; its upper edge of a camera that looks down is
    ahead, as autopilots have it."""
    ray = np.array([-below, -right, -1.0]) if mount == "down" else np.array([1.0, -right, -below])
    return Sighting(ray / np.linalg.norm(ray), metres)
