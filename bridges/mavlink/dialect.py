"""The one dialect that is needed, as MAVLink 2.

Everything here goes through pymavlink's generated packer and parser; its `mavutil` is not used: that spins on
a dead TCP link, prints, and is not thread-safe. What runs over the wire is `wire.Wire`, what carries it
`carriers`. `ardupilotmega` is `common` plus the messages by which an ArduPilot reports its EKF.
"""

import os

os.environ.setdefault("MAVLINK20", "1")
os.environ.setdefault("MAVLINK_DIALECT", "ardupilotmega")

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Message = Any  # a pymavlink message; `get_type()`, `get_srcSystem()`, `get_srcComponent()` and its fields

__all__ = ["Message", "mavlink"]
