"""A whole simulated MAVLink vehicle, bytes in and frames out, at times that its driver tells."""

from collections.abc import Hashable, Iterable

from sim.mavlink.ardupilot import ArduPilot
from sim.mavlink.autopilot import Autopilot
from sim.mavlink.port import Port
from sim.mavlink.px4 import Px4
from sim.mavlink.settings import Settings


def autopilot_of(settings: Settings) -> Autopilot:
    """The pure vehicle of some settings."""
    return Px4(settings) if settings.autopilot == "px4" else ArduPilot(settings)


class MavlinkVehicle:
    """An autopilot behind a wire. Pure: no socket, no clock."""

    def __init__(self, settings: Settings) -> None:
        self.autopilot = autopilot_of(settings)
        self.port = Port(settings, self.autopilot.faults)

    def __repr__(self) -> str:
        return f"MavlinkVehicle({self.autopilot!r}, {self.port!r})"

    def step(self, now: float, received: Iterable[tuple[Hashable, bytes]] = ()) -> list[bytes]:
        """Live until `now`, hear what each peer sent, and return the frames for all peers."""
        since = self.autopilot.switched_on()
        messages = [message for peer, data in received for message in self.port.receive(peer, data, since)]
        said = self.autopilot.step(now, messages)
        return self.port.send(said, self.autopilot.switched_on())
