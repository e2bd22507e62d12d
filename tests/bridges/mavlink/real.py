"""Real autopilots without a screen, for whoever has them: nothing of them is in this repository.

`SEARCHPARTY_ARDUPILOT` is the path of an `arducopter` built for the board "sitl"; an `ardurover` beside it
drives the rover tests. `SEARCHPARTY_PX4` is the path of a `px4` built as px4_sitl, with its `etc` beside its
`bin`; it flies with the simulation that it has inside (SIH).
"""

import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import pytest

from bridges.mavlink.bridge import Bridge
from bridges.mavlink.commands import Command
from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.link import Link

HOME = (47.3977, 8.5456, 488.0)
ARDUPILOT, PX4 = os.environ.get("SEARCHPARTY_ARDUPILOT", ""), os.environ.get("SEARCHPARTY_PX4", "")
GCS = (255, 190)


def needed(kind: str) -> Path:
    """The program that plays `kind`; skips where there is none."""
    if kind == "px4":
        path, how = Path(PX4), "SEARCHPARTY_PX4 names no px4 built for SITL"
    else:
        name = "ardurover" if kind == "rover" else "arducopter"
        path = Path(ARDUPILOT).with_name(name) if ARDUPILOT else Path()
        how = f"SEARCHPARTY_ARDUPILOT names no {name} built for SITL"
    if not path.is_file():
        pytest.skip(how)
    return path.resolve()


def ardupilot_parameters(kind: str) -> dict[str, float]:
    """What its simulated sensors are calibrated to, and a frame: without them it arms for nobody."""
    found: dict[str, float] = {"BATT_MONITOR": 4}
    for compass in ("", "2", "3"):
        for axis, offset in zip("XYZ", (5, 13, -18), strict=True):
            found[f"COMPASS_OFS{compass}_{axis}"] = offset
    for sensor in ("", "2"):
        for axis in "XYZ":
            found[f"INS_ACC{sensor}OFFS_{axis}"] = 0.001
            found[f"INS_ACC{sensor}SCAL_{axis}"] = 1.001
    for axis in "XYZ":
        found[f"INS_ACC3OFFS_{axis}"], found[f"INS_ACC3SCAL_{axis}"] = 0.0, 1.0
    for channel in (1, 2, 3, 4):
        for what, value in (("MIN", 1000), ("MAX", 2000), ("TRIM", 1500)):
            found[f"RC{channel}_{what}"] = value
    if kind == "ardupilot":
        found.update(FRAME_CLASS=1, FRAME_TYPE=0, FS_THR_ENABLE=1)
    else:
        found.update(CRUISE_SPEED=5, CRUISE_THROTTLE=30, WP_SPEED=5, ATC_STR_RAT_FF=0.75, ATC_SPEED_P=0.1)
        found.update(SERVO1_MIN=1000, SERVO1_MAX=2000, SERVO3_MIN=1000, SERVO3_MAX=2000)
    return found


class Router:
    """What a MAVLink router does: all peers of one UDP port hear each other. `cut` lets nothing through."""

    def __init__(self, port: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(0.1)
        self.port = self._socket.getsockname()[1]
        self.url = f"udpout:127.0.0.1:{self.port}"
        self.cut = False
        self._peers: set[tuple[str, int]] = set()
        self._ending = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Router":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending = True
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while not self._ending:
            try:
                data, peer = self._socket.recvfrom(65536)
            except OSError:
                continue
            self._peers.add(peer)
            for other in () if self.cut else tuple(self._peers - {peer}):
                with suppress(OSError):
                    self._socket.sendto(data, other)


def free_instance(*ports: int, step: int = 10) -> int:
    """A number of which no port is taken: simulators count their ports up by it."""
    for instance in range(1, 90):
        try:
            for port in ports:
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
                    trial.bind(("127.0.0.1", port + step * instance))
        except OSError:
            continue
        return instance
    raise AssertionError("no free ports")


class Real:
    """One autopilot with its simulated vehicle, speaking to the router's port."""

    def __init__(
        self,
        kind: str,
        folder: Path,
        router: Router,
        system: int = 1,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        program = needed(kind)
        self.kind, self.system = kind, system
        folder.mkdir(parents=True, exist_ok=True)
        environment = dict(os.environ)
        if kind == "px4":
            number = system - 1  # it makes its system id of it
            environment |= {"PX4_SIM_MODEL": "sihsim_quadx", "HEADLESS": "1"}
            environment |= {"PX4_HOME_LAT": str(HOME[0]), "PX4_HOME_LON": str(HOME[1])}
            environment |= {"PX4_HOME_ALT": str(HOME[2])}
            environment |= {f"PX4_PARAM_{name}": f"{value:g}" for name, value in (parameters or {}).items()}
            etc = program.parent.parent / "etc"
            command = [str(program), "-d", "-i", str(number), "-w", str(folder), str(etc)]
        else:
            values = ardupilot_parameters(kind) | dict(parameters or {})
            text = "".join(f"{name} {value}\n" for name, value in values.items())
            (folder / "defaults.parm").write_text(text, encoding="ascii")
            number = free_instance(5501, 9003, 9005)
            place = ",".join(str(value) for value in (*HOME, 0))
            command = [str(program), "--model", "rover" if kind == "rover" else "quad", "--speedup", "1"]
            command += ["--wipe", "--home", place, "--sysid", str(system), "--instance", str(number)]
            command += ["--defaults", "defaults.parm", "--serial0", f"udpclient:127.0.0.1:{router.port}"]
            command += ["--serial1", "none:", "--serial2", "none:"]
        self._log = (folder / "log.txt").open("wb")
        self.process = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=self._log,
            stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip

    def __enter__(self) -> "Real":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for sign in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, sign)
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(5.0)
                break
        self._log.close()


def stage(kind: str) -> tuple[int, Router]:
    """A system id and a router where it will send: a PX4 has fixed ports for a companion computer."""
    if kind != "px4":
        return 1, Router()
    instance = free_instance(14540, 14580, 14280, 13030, 18570, step=1)
    return instance + 1, Router(14540 + instance)


class Station:
    """A ground station on the same link, as an operator would have it."""

    def __init__(self, router: Router) -> None:
        self.link = Link(router.url, GCS, heed=lambda *_: True)

    def __enter__(self) -> "Station":
        self.link.start()
        for _ in range(3):
            self.beat()
            time.sleep(0.2)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.link.close()

    def beat(self) -> None:
        """A heartbeat of a ground station."""
        state = mavlink.MAV_STATE_ACTIVE
        self.link.send(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
            )
        )

    def command(self, command: Command, system: int) -> None:
        """Sent three times, as people press buttons."""
        for _ in range(3):
            self.link.send(command.message(system, 1, 0))
            time.sleep(0.1)

    def drain(self) -> list[Message]:
        """What came since the last time."""
        return self.link.drain()


def until(condition: Callable[[], bool], seconds: float, what: str, bridge: Bridge | None = None) -> float:
    """Wait for something; how long it took."""
    begin = time.monotonic()
    while time.monotonic() - begin < seconds:
        if condition():
            return time.monotonic() - begin
        time.sleep(0.02)
    told = [event.text for event in bridge.events()] if bridge is not None else []
    raise AssertionError((what, bridge and bridge.report(), told))
