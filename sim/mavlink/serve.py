"""Runs a simulated vehicle behind sockets in real time, or faster."""

import selectors
import threading
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from sim.mavlink.autopilot import TICK, Autopilot
from sim.mavlink.body import warm
from sim.mavlink.carriers import Carrier, carrier_of
from sim.mavlink.settings import Fault, Settings
from sim.mavlink.vehicle import MavlinkVehicle

T = TypeVar("T")


class Server:
    """A vehicle and its carriers. `speed` vehicle seconds pass in a second of the wall's."""

    def __init__(self, settings: Settings, urls: Sequence[str], speed: float = 1.0) -> None:
        warm()
        self.vehicle = MavlinkVehicle(settings.but(unix_start=time.time()))
        self._selector = selectors.DefaultSelector()
        self._speed = speed
        self._urls = list(urls)
        self._carriers: list[Carrier] = []
        self._stop = threading.Event()
        self.open()

    def __repr__(self) -> str:
        return f"Server({self.vehicle!r}, {self._urls})"

    def open(self) -> None:
        """(Re)open the sockets, on the ports that they had."""
        self._carriers = [carrier_of(url, self._selector) for url in self._urls]
        for index, carrier in enumerate(self._carriers):
            carrier.lost = self.vehicle.port.forget
            if self._urls[index].endswith(":0"):
                self._urls[index] = self._urls[index][:-1] + carrier.client_url().rpartition(":")[2]

    def shut(self) -> None:
        """Close the sockets; the vehicle lives on."""
        for carrier in self._carriers:
            carrier.close()
        self._carriers = []

    @property
    def client_urls(self) -> list[str]:
        return [carrier.client_url() for carrier in self._carriers]

    def run_once(self) -> None:
        """Wait for bytes, but not longer than a tick, and step the vehicle."""
        if self._selector.get_map():
            ready = self._selector.select(TICK / self._speed)
        else:
            time.sleep(TICK / self._speed)
            ready = []
        now = time.monotonic()
        received = [part for key, _ in ready for part in key.data.receive(key.fileobj, now)]
        frames = self.vehicle.step(now * self._speed, received)
        for carrier in self._carriers:
            carrier.send(frames, now)

    def run(self) -> None:
        """Until `stop`."""
        while not self._stop.is_set():
            self.run_once()

    def stop(self) -> None:
        self._stop.set()

    @property
    def stopped(self) -> bool:
        return self._stop.is_set()

    def close(self) -> None:
        self.shut()
        self._selector.close()


class Served:
    """A vehicle served in a thread of its own, for tests and rehearsals.

        with Served(Settings(autopilot="px4")) as vehicle:
            Link(vehicle.url, ...)

    `url` is the first link as a client names it. All access to the autopilot goes through `ask`.
    """

    def __init__(self, settings: Settings, *urls: str, speed: float = 1.0) -> None:
        self._server = Server(settings, urls or ("tcpin:127.0.0.1:0",), speed)
        self.urls = self._server.client_urls
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="simulated-vehicle", daemon=True)
        self._trouble: BaseException | None = None

    def __repr__(self) -> str:
        return f"Served({self._server!r})"

    @property
    def url(self) -> str:
        return self.urls[0]

    def __enter__(self) -> "Served":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()
        self._thread.join(5.0)
        self._server.close()
        if self._trouble is not None:
            raise self._trouble

    def ask(self, question: Callable[[Autopilot], T]) -> T:
        """What a function of the autopilot says, between two steps."""
        with self._lock:
            return question(self._server.vehicle.autopilot)

    def fault(self, fault: Fault) -> None:
        """Let something go wrong; its times count from now."""

        def add(autopilot: Autopilot) -> None:
            since = autopilot.switched_on()
            start, end = since + fault.start, since + fault.end
            autopilot.faults.add(Fault(fault.kind, start, end, fault.value))

        self.ask(add)

    def wait_for(self, condition: Callable[[Autopilot], bool], seconds: float) -> bool:
        """Whether a condition comes true within so many seconds of the wall's clock."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.ask(condition):
                return True
            time.sleep(0.01)
        return self.ask(condition)

    def cut(self) -> None:
        """The link is gone: sockets closed, ports refused. The vehicle lives on."""
        with self._lock:
            self._server.shut()

    def mend(self) -> None:
        """The link is back, at the same address."""
        with self._lock:
            self._server.open()

    def _run(self) -> None:
        try:
            while not self._server.stopped:
                with self._lock:
                    self._server.run_once()
                time.sleep(0.0005)  # lets `ask` in
        except BaseException as error:
            self._trouble = error
