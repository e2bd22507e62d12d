"""A flight that can also leave a way to the autopilot, as a mission on board: for long-range links.

While it holds in the air, the way is uploaded; then the autopilot's own mission mode flies it ("following"),
with no setpoint from us. At its end, or when anything else is wanted, it comes back to our setpoints.
"""

import numpy as np

from bridges.mavlink.autopilot import Autopilot
from bridges.mavlink.commands import Commands
from bridges.mavlink.dialect import Message
from bridges.mavlink.flight import Flight, Say
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.takeover import UNTIL, who
from bridges.mavlink.vehicle_state import VehicleReport
from bridges.mavlink.wanted import GoTo, Land, Return, TakeOff, Task, Way
from bridges.mavlink.ways import Ways
from estimator.arrays import FloatArray

SAMPLE = 2.0  # m between the places of a way at which the fence is asked
NEAR = 3.0  # m from its end a way may be over before the autopilot has said so
STOOD = 3.0  # s that it stands there, if the autopilot never says so
STANDS = 0.3  # m/s


class WayFlight(Flight):
    """Adds the phase "following", and the task `Way`."""

    def __init__(
        self, config: PilotConfig, autopilot: Autopilot, commands: Commands, say: Say, ways: Ways
    ) -> None:
        super().__init__(config, autopilot, commands, say)
        self._ways = ways
        self._way: Way | None = None  # that is followed, or was to its end
        self._ended = False
        self._came_back = False  # from following: its end may change the mode a moment later
        self._moved = 0.0
        self._judged: tuple[Way, str | None] | None = None

    @property
    def ours(self) -> bool:
        return self.phase == "following" or super().ours

    def step(self, now: float, report: VehicleReport, task: Task, reasons: list[str]) -> list[Message]:
        if self.phase == "following":
            return self._following(now, report, task)
        if self._came_back and self.phase == "engaging":
            if self.autopilot.mode(report) == self.autopilot.hold_mode:
                self._mode_before = self.autopilot.hold_mode
        else:
            self._came_back = False
        if not isinstance(task, Way):
            return super().step(now, report, task, reasons)
        if self.phase != "flying":
            return super().step(now, report, TakeOff(), reasons)
        if task is self._way and self._ended:
            return super().step(now, report, GoTo(task.route[-1]), reasons)
        out = super().step(now, report, TakeOff(), reasons)  # holds, and notices who takes it
        refused = self._forbidden(task)
        if refused is not None:
            self._refuse(refused)
        elif self.phase == "flying":
            self._ways.want(task)
            self.trouble = self._ways.trouble
            if self._ways.on_board is task:
                self._way, self._ended, self._moved = task, self._ways.ended, now
            if self._ways.on_board is task and not self._ended:
                self._ways.begin()
                self._enter("following", now)
        return out

    def _following(self, now: float, report: VehicleReport, task: Task) -> list[Message]:
        mode, own = self.autopilot.mode(report), self.autopilot.mission_mode
        assert self._way is not None
        near = self._away(report, self._way) < NEAR
        wanted = own
        if isinstance(task, Land | Return):
            wanted = self.autopilot.land_mode if isinstance(task, Land) else self.autopilot.return_mode
        fine = {own, wanted} | ({self.autopilot.hold_mode} if near or self._ways.ended else set())
        if "there" not in self._asked:
            fine.add(self.autopilot.guided)
        if not report.armed:
            self.take_over(now, f"it was disarmed in mode {mode} while it was ours; {UNTIL}")
            return []
        if mode not in fine:
            self.take_over(now, who(report, mode, now))
            return []
        if wanted != own:  # straight from there, without a moment of setpoints
            if mode == wanted:
                self._enter("landing" if isinstance(task, Land) else "returning", now)
            else:
                self._ask_mode(now, wanted)
            return []
        if task is not self._way or self._over(now, report, mode, near):
            self._ended = task is self._way
            self._come_back(now, mode)
            return []
        if mode == own:
            self._asked.setdefault("there", now)
            return []
        self._ask_mode(now, own)
        # Until it flies by itself it is held by setpoints: a PX4 without any would leave for another mode.
        return self._setpoints.hold(now, report) if mode == self.autopilot.guided else []

    def _over(self, now: float, report: VehicleReport, mode: str, near: bool) -> bool:
        """Whether the way is flown: it was said, or it stands at the end."""
        if "there" not in self._asked:
            return False
        slow = report.velocity is not None and float(np.linalg.norm(report.velocity)) < STANDS
        if not (near and slow):
            self._moved = now
        changed = mode != self.autopilot.mission_mode  # it has gone to hold by itself
        return changed or (self._ways.ended and slow) or now - self._moved > STOOD

    def _come_back(self, now: float, mode: str) -> None:
        self._taking = self._came_back = True
        self._starts = 0
        self._setpoints.let_go()
        self._mode_before = mode
        self._enter("engaging", now)

    def _away(self, report: VehicleReport, way: Way) -> float:
        return np.inf if report.position is None else float(np.linalg.norm(report.position - way.route[-1]))

    def _forbidden(self, way: Way) -> str | None:
        """Why a way may not be flown, judged once: all of it must be inside of the fence."""
        if self._judged is None or self._judged[0] is not way:
            self._judged = (way, self._judge(way.route))
        return self._judged[1]

    def _judge(self, route: FloatArray) -> str | None:
        if route.ndim != 2 or route.shape[1] != 3 or not len(route) or not np.isfinite(route).all():
            return "a way was asked for which is none"
        permit = self._config.permit
        if permit is None:
            return None
        for begin, end in zip(route[[0, *range(len(route) - 1)]], route, strict=True):
            count = max(2, int(np.linalg.norm(end - begin) / SAMPLE) + 1)
            for share in np.linspace(0.0, 1.0, count):
                found = permit(begin + share * (end - begin))
                if found is not None:
                    return found
        return None
