"""When the robot's wish gives way: fallbacks, the fence, and failsafes that the mission relies on."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from bridges.mavlink.autopilot import Failsafe
from bridges.mavlink.pilot_config import PilotConfig
from bridges.mavlink.vehicle_state import VehicleReport
from bridges.mavlink.wanted import Drive, GoTo, Hold, Land, Return, Task, Wanted

GRAVITY = {"continue": 0, "hold": 1, "return": 2, "land": 3}
AHEAD = 1.0  # s of a velocity that must stay inside
REACTION: dict[str, Task] = {"hold": Hold(), "return": Return(), "land": Land()}


@dataclass(frozen=True, slots=True)
class Fallback:
    """What is done instead of what was wanted, and why."""

    action: str
    reason: str
    lasting: bool  # not undone when the reason goes away

    @property
    def task(self) -> Task:
        return REACTION[self.action]


def fallback(
    config: PilotConfig, report: VehicleReport, wanted: Wanted, robot_age: float, now: float
) -> Fallback | None:
    """The gravest that applies to a flying vehicle; None: the robot has its way."""
    rules = config.fallbacks
    found: list[Fallback] = []

    def add(action: str, reason: str, lasting: bool = False) -> None:
        if action != "continue":
            found.append(Fallback(action, reason, lasting))

    if report.battery is not None and report.battery <= rules.low_battery:
        percent = f"battery at {report.battery:.0%}, below {rules.low_battery:.0%}"
        add(rules.on_low_battery, percent, lasting=True)
    age = report.age("LOCAL_POSITION_NED", now)
    if age > rules.pose_stale_s:
        add(rules.on_pose_stale, f"no position from it for {rules.pose_stale_s:g} s")
    if wanted.team_age > rules.team_lost_s:
        add(rules.on_team_lost, f"nothing heard of the team for {rules.team_lost_s:g} s")
    if robot_age > rules.robot_silent_s:
        add(rules.on_robot_silent, f"the robot has been silent for {rules.robot_silent_s:g} s")
    if config.breach is not None and report.position is not None:
        breach = config.breach(report.position)
        if breach is not None:
            add(rules.on_outside, breach, lasting=True)
    return max(found, key=lambda one: (GRAVITY[one.action], one.lasting), default=None)


def forbidden(config: PilotConfig, report: VehicleReport, task: Task) -> str | None:
    """Why a setpoint may not be sent; None: it may."""
    if isinstance(task, GoTo):
        if task.position.shape != (3,) or not np.isfinite(task.position).all():
            return f"a position of {task.position.tolist()} was asked for, which is none"
        where = task.position
    elif isinstance(task, Drive):
        if task.velocity.shape != (3,) or not np.isfinite(task.velocity).all():
            return f"a velocity of {task.velocity.tolist()} was asked for, which is none"
        if report.position is None:
            return "a velocity was asked for where no position is known"
        where = report.position + AHEAD * task.velocity
    else:
        return None
    if task.yaw is not None and not np.isfinite(task.yaw):
        return f"a yaw of {task.yaw} was asked for, which is none"
    return config.permit(where) if config.permit is not None else None


def unreliable(config: PilotConfig, failsafes: Iterable[Failsafe]) -> list[str]:
    """Which of the failsafes that the mission relies on are set otherwise, with both values."""
    known = {one.cause: one for one in failsafes}
    reasons = []
    for cause, action in sorted(config.failsafes.items()):
        one = known.get(cause)
        if one is None:
            reasons.append(
                f'the mission relies on "{action}" for {cause}, but the autopilot says nothing of it'
            )
        elif action != one.action:
            reasons.append(f'the mission relies on "{action}" for {cause}, but the autopilot has {one.words}')
    return reasons


class Reserve:
    """Chooses between the robot's wish and a fallback; one that lasts stays until `forget`."""

    def __init__(self, config: PilotConfig, say: Callable[[str, str], None]) -> None:
        self._config = config
        self._say = say
        self.now: Fallback | None = None

    def __repr__(self) -> str:
        return f"Reserve({self.now})"

    @property
    def grounds(self) -> bool:
        """Whether it must come down and stay there."""
        return self.now is not None and self.now.lasting and self.now.action in ("land", "return")

    def forget(self) -> None:
        """A person has looked at it."""
        self.now = None

    def task(self, now: float, report: VehicleReport, wanted: Wanted, robot_age: float) -> Task:
        """What a flying vehicle does now."""
        before, found = self.now, fallback(self._config, report, wanted, robot_age, now)
        if before is not None and before.lasting:
            graver = found is not None and GRAVITY[found.action] > GRAVITY[before.action]
            found = found if graver else before
        if found is None:
            if before is not None:
                self._say("info", f"over: {before.reason}")
            self.now = None
            return wanted.task
        if before is None or (found.action, found.lasting) != (before.action, before.lasting):
            self._say("warning", f"{found.reason}: {found.action}")
        self.now = found
        return found.task
