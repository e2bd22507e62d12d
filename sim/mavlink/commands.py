"""COMMAND_LONG, COMMAND_INT and SET_MODE: who asked for what, what came of it, and the acknowledgement."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridges.mavlink.dialect import Message, mavlink
from sim.mavlink import telemetry

if TYPE_CHECKING:
    from sim.mavlink.autopilot import Autopilot

ACCEPTED, BUSY, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = 0, 1, 2, 3, 4, 5
ARM_DISARM, SET_MODE_COMMAND, TAKEOFF, LAND, RETURN, REPOSITION = 400, 176, 22, 21, 20, 192
FORCE = 21196.0
LENGTHY = {ARM_DISARM, SET_MODE_COMMAND, TAKEOFF, LAND, RETURN, REPOSITION, 300}
REPORT = 0.4  # s between IN_PROGRESS reports
UNSET = 2**31 - 1
GLOBAL = {0, 3, 5, 6, 10, 11}
RELATIVE = {3, 6}


@dataclass(frozen=True, slots=True)
class Command:
    """A command, however it came. `x` and `y` are degrees or metres; NaN: not given."""

    id: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    frame: int | None  # None: it came as COMMAND_LONG
    source: tuple[int, int]

    @staticmethod
    def of(message: Message) -> "Command":
        source = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() == "SET_MODE":
            params = (float(message.base_mode), float(message.custom_mode), 0.0, 0.0)
            return Command(11, params, math.nan, math.nan, math.nan, None, source)
        params = (message.param1, message.param2, message.param3, message.param4)
        if message.get_type() == "COMMAND_LONG":
            x, y, z = message.param5, message.param6, message.param7
            return Command(message.command, params, x, y, z, None, source)
        scale = 1e-7 if message.frame in GLOBAL else 1e-4
        x, y = (math.nan if value == UNSET else value * scale for value in (message.x, message.y))
        return Command(message.command, params, x, y, message.z, message.frame, source)

    @property
    def has_place(self) -> bool:
        return math.isfinite(self.x) and math.isfinite(self.y) and (self.x, self.y) != (0.0, 0.0)


@dataclass(slots=True)
class _Lengthy:
    command: Command
    due: float
    began: float
    reported: float


class Desk:
    """Takes commands in and answers them."""

    def __init__(self, vehicle: "Autopilot") -> None:
        self._vehicle = vehicle
        self._lengthy: dict[tuple[int, tuple[int, int]], _Lengthy] = {}
        self._common: dict[int, Callable[[Command], int]] = {
            246: self._reboot,
            410: lambda _: self._tell(242),
            510: self._get_interval,
            511: self._set_interval,
            512: lambda command: self._tell(int(command.params[0])),
            520: lambda _: self._tell(148),
            179: self._set_home,
        }

    def __repr__(self) -> str:
        return f"Desk(in progress: {[key[0] for key in self._lengthy]})"

    def clear(self) -> None:
        self._lengthy = {}

    def receive(self, message: Message) -> None:
        command = Command.of(message)
        key = (command.id, command.source)
        vehicle = self._vehicle
        if vehicle.fault("busy"):
            self._ack(command, BUSY)
            return
        wait = vehicle.faults.amount("in_progress", vehicle.switched_on())
        if wait > 0.0 and command.id in LENGTHY:
            if key not in self._lengthy:  # a repeated one is the same one
                self._lengthy[key] = _Lengthy(command, vehicle.now + wait, vehicle.now, vehicle.now)
            self._ack(command, IN_PROGRESS)
            return
        self._ack(command, self._carry_out(command))

    def tick(self) -> None:
        now = self._vehicle.now
        for key, work in list(self._lengthy.items()):
            if now >= work.due:
                del self._lengthy[key]
                self._ack(work.command, self._carry_out(work.command))
            elif now - work.reported >= REPORT:
                work.reported = now
                progress = round(100 * (now - work.began) / (work.due - work.began))
                self._ack(work.command, IN_PROGRESS, progress)

    def _carry_out(self, command: Command) -> int:
        handler = self._vehicle.commands.get(command.id) or self._common.get(command.id)
        return UNSUPPORTED if handler is None else handler(command)

    def _ack(self, command: Command, result: int, progress: int = 0) -> None:
        self._vehicle.send(
            mavlink.MAVLink_command_ack_message(command.id, result, progress, 0, *command.source)
        )

    def _tell(self, message_id: int) -> int:
        build = self._vehicle.builders.get(message_id)
        if message_id == 244 or build is None:
            return FAILED
        made = build(self._vehicle)
        self._vehicle.send(made)
        return FAILED if made is None else ACCEPTED

    def _set_interval(self, command: Command) -> int:
        message_id, interval = int(command.params[0]), command.params[1]
        if message_id not in self._vehicle.builders or not math.isfinite(interval):
            return FAILED
        self._vehicle.streams.set(message_id, interval * 1e-6, self._vehicle.now)
        return ACCEPTED

    def _get_interval(self, command: Command) -> int:
        message_id = int(command.params[0])
        interval = (
            self._vehicle.streams.interval_us(message_id) if message_id in self._vehicle.builders else 0
        )
        self._vehicle.send(mavlink.MAVLink_message_interval_message(message_id, interval))
        return ACCEPTED

    def _reboot(self, command: Command) -> int:
        if command.params[0] not in (1.0, 3.0):
            return UNSUPPORTED
        if self._vehicle.armed:
            return FAILED if self._vehicle.wire_autopilot == 3 else DENIED
        self._ack(command, ACCEPTED)
        self._vehicle.boot()
        return ACCEPTED

    def _set_home(self, command: Command) -> int:
        vehicle = self._vehicle
        if not vehicle.has_position():
            return FAILED
        here = vehicle.geodetic(vehicle.body.position)
        if command.params[0] != 1.0:
            if not command.has_place or abs(command.x) > 90 or abs(command.y) > 180:
                return DENIED
            here = (command.x, command.y, command.z)
        vehicle.home = here
        vehicle.send(telemetry.home_position(vehicle))
        return ACCEPTED
