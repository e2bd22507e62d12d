"""What a vehicle does in a mode, apart from what the mode is called: hold, go, take off, land, return."""

import math
from typing import Literal

from sim.mavlink.body import STEP, Body, Limits, Vector

Task = Literal["rest", "hold", "goto", "drive", "takeoff", "land", "climb", "back"]
NEAR = 0.5  # m: there
FINAL = 10.0  # m above the ground from which it lands slowly


class Guidance:
    """The task of the moment; `tick` moves the body."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.task: Task = "rest"
        self.target: Vector | None = None
        self.velocity: Vector = (0.0, 0.0, 0.0)
        self.limits = Limits(5.0, 2.5, 1.5)
        self.land_speed = 0.5
        self.lands_at_home = True
        self.faces_way = True  # without a yaw: True: looks where it goes; False: keeps it
        self.yaw: float | None = None
        self.yaw_rate: float | None = None

    def __repr__(self) -> str:
        return f"Guidance({self.task}, target={self.target}, {self.body!r})"

    def rest(self) -> None:
        """Nothing is asked of the body: on the ground it stands, in the air it stays."""
        self._set("rest", None)

    def hold(self) -> None:
        self._set("hold", None)

    def goto(self, target: Vector, yaw: float | None = None, yaw_rate: float | None = None) -> None:
        self._set("goto", target)
        self.yaw, self.yaw_rate = yaw, yaw_rate

    def drive(self, velocity: Vector, yaw: float | None = None, yaw_rate: float | None = None) -> None:
        self._set("drive", None)
        self.velocity, self.yaw, self.yaw_rate = velocity, yaw, yaw_rate

    def take_off(self, down: float) -> None:
        """Rise straight to a height, `down` in local NED."""
        north, east, _ = self.body.position
        self._set("takeoff", (north, east, down))

    def land(self) -> None:
        north, east, _ = self.body.position
        self._set("land", (north, east, 5.0))

    def back(self, home: Vector, down: float, lands: bool = True) -> None:
        """Rise to `down` if lower, go above home, land there."""
        north, east, now = self.body.position
        self.lands_at_home = lands
        self._home = (home[0], home[1], min(now, down))
        self._set("climb", (north, east, min(now, down)))

    def near_target(self) -> bool:
        return self.target is None or math.dist(self.target, self.body.position) <= NEAR

    def tick(self, steps: int) -> None:
        """Move on for so many control steps."""
        if self.task == "climb" and self.near_target():
            self._set("back", self._home)
        if self.task == "back" and self.near_target():
            if self.lands_at_home:
                self.land()
            else:
                self.hold()
        if self.task == "land":
            low = -self.body.position[2] < FINAL
            down = min(self.land_speed, self.limits.down) if low else self.limits.down
            self._go(Limits(self.limits.level, self.limits.up, down))
        elif self.target is not None:
            self._go(self.limits)
        else:
            self.body.drive(self.velocity)
        self.body.turn(self._wanted_yaw(), self.yaw_rate, steps * STEP)
        self.body.advance(steps)

    def _go(self, limits: Limits) -> None:
        assert self.target is not None
        self.body.goto(self.target, limits)

    def _wanted_yaw(self) -> float | None:
        if self.yaw is not None:
            return self.yaw
        if self.yaw_rate is not None or not self.faces_way or self.task not in ("goto", "back"):
            return None
        assert self.target is not None
        north = self.target[0] - self.body.position[0]
        east = self.target[1] - self.body.position[1]
        return math.atan2(east, north) if math.hypot(north, east) > 2.0 else None

    def _set(self, task: Task, target: Vector | None) -> None:
        if target is not None and not self.body.flies:
            target = (target[0], target[1], self.body.position[2])
        self.task, self.target = task, target
        self.velocity = (0.0, 0.0, 0.0)
        self.yaw = self.yaw_rate = None
