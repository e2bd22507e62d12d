"""MAVProxy, ArduPilot's own ground station, shows parameters and modes of the simulated one and flies it."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim.mavlink.serve import Served
from sim.mavlink.settings import Settings

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(
        importlib.util.find_spec("MAVProxy") is None,
        reason="MAVProxy is not installed: pip install 'searchparty[mavproxy]'",
    ),
]
MODULES = "mode,arm,param,misc,cmdlong,link"
SCRIPT = Path(sys.executable).with_name("mavproxy.py")


class Station:
    """MAVProxy as a process: what is typed, and what is on its screen."""

    def __init__(self, url: str, directory: Path) -> None:
        self._log = directory / "screen.txt"
        arguments = [
            sys.executable,
            str(SCRIPT),
            "--master",
            url,
            "--state-basedir",
            str(directory),
            "--default-modules",
            MODULES,
        ]
        with self._log.open("wb") as screen:
            self.process = subprocess.Popen(
                arguments,
                cwd=directory,
                stdin=subprocess.PIPE,
                stdout=screen,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )

    def type(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n".encode())
        self.process.stdin.flush()

    def shows(self, text: str, seconds: float = 40.0) -> bool:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if text in self._log.read_text(errors="replace"):
                return True
            time.sleep(0.05)
        print(self._log.read_text(errors="replace"))
        return False

    def close(self) -> None:
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        assert self.process.stdin is not None
        self.process.stdin.close()


def test_it_connects_shows_parameters_and_modes_and_flies(tmp_path: Path) -> None:
    with Served(Settings(), speed=3.0) as vehicle:
        count = vehicle.ask(lambda pilot: pilot.parameters.count)
        station = Station(vehicle.url, tmp_path)
        try:
            assert station.shows("Detected vehicle 1:1")
            assert station.shows(f"Received {count} parameters")
            station.type("param show FS_GCS_TIMEOUT")
            assert station.shows("FS_GCS_TIMEOUT   5.0")
            station.type("mode guided")
            assert station.shows("Mode GUIDED")
            station.type("arm throttle")
            assert station.shows("ARMED")
            station.type("takeoff 5")
            assert station.shows("NAV_TAKEOFF: ACCEPTED")
            assert vehicle.wait_for(lambda pilot: -pilot.body.position[2] > 4.5, 20.0)
            station.type("mode land")
            assert station.shows("Mode LAND")
        finally:
            station.close()
