"""Simulated vehicles behind real sockets."""

import os
import selectors
import signal
import socket
import subprocess
import sys
import time
from typing import Any

import pytest

from agents.errors import LinkError, MissionError
from bridges.mavlink.dialect import mavlink
from sim.mavlink.__main__ import main
from sim.mavlink.carriers import carrier_of
from sim.mavlink.serve import Served
from sim.mavlink.settings import Fault, Settings

pytestmark = pytest.mark.processes
PATIENCE = 20.0


class Client:
    """A bare socket with pymavlink's parser."""

    def __init__(self, url: str) -> None:
        kind, host, port = url.split(":")
        if kind == "tcp":
            self.socket = socket.create_connection((host, int(port)), timeout=PATIENCE)
        else:
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.socket.settimeout(PATIENCE)
            self.socket.connect((host, int(port)))
        self.mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.mav.robust_parsing = True

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def say(self, message: Any) -> None:
        self.socket.send(message.pack(self.mav))

    def hear(self, kind: str) -> Any:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            data = self.socket.recv(65536)
            if not data:
                break
            for message in self.mav.parse_buffer(data) or []:
                if message.get_type() == kind:
                    return message
        raise AssertionError(f"no {kind}")


def heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


@pytest.mark.parametrize("url", ["tcpin:127.0.0.1:0", "udpin:127.0.0.1:0"])
def test_several_clients_hear_the_same_vehicle(url: str) -> None:
    with (
        Served(Settings(system_id=9), url) as vehicle,
        Client(vehicle.url) as one,
        Client(vehicle.url) as two,
    ):
        for client in (one, two):
            client.say(heartbeat())
        assert [client.hear("HEARTBEAT").get_srcSystem() for client in (one, two)] == [9, 9]


def test_udpout_finds_a_client_that_waits() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waiting:
        waiting.bind(("127.0.0.1", 0))
        waiting.settimeout(PATIENCE)
        with Served(Settings(), f"udpout:127.0.0.1:{waiting.getsockname()[1]}"):
            assert waiting.recv(1000)[0] == 0xFD


def test_tcp_reconnects_to_a_server_that_comes_late() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(PATIENCE)
        with Served(Settings(), f"tcp:127.0.0.1:{server.getsockname()[1]}"):
            time.sleep(0.1)
            server.listen()
            for _ in range(2):
                connection, _ = server.accept()
                with connection:
                    connection.settimeout(PATIENCE)
                    assert connection.recv(1000)[0] == 0xFD


def test_a_link_is_cut_and_mended_at_the_same_address_and_the_vehicle_lives_on() -> None:
    with Served(Settings()) as vehicle:
        with Client(vehicle.url) as client:
            client.hear("HEARTBEAT")
            vehicle.cut()
            while client.socket.recv(65536):
                pass
        with pytest.raises(ConnectionRefusedError):
            Client(vehicle.url)
        vehicle.mend()
        with Client(vehicle.url) as client:
            client.hear("HEARTBEAT")
        assert vehicle.ask(lambda pilot: pilot.switched_on()) > 0.0


def test_faults_come_while_it_runs() -> None:
    with Served(Settings(), speed=5.0) as vehicle:
        assert vehicle.wait_for(lambda pilot: pilot.has_position(), PATIENCE)
        vehicle.fault(Fault("operator_mode", value="LOITER"))
        assert vehicle.wait_for(lambda pilot: pilot.mode == "LOITER", PATIENCE)


def test_what_is_no_link_or_taken_is_said() -> None:
    with selectors.DefaultSelector() as selector:
        with pytest.raises(MissionError, match="expected udpin, udpout, tcpin or tcp"):
            carrier_of("carrier-pigeon:1", selector)
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            with pytest.raises(LinkError, match=f"cannot open tcpin:127.0.0.1:{port}"):
                carrier_of(f"tcpin:127.0.0.1:{port}", selector)


def test_the_process_serves_until_a_signal() -> None:
    arguments = ["--url", "tcpin:127.0.0.1:0", "--autopilot", "px4", "--system-id", "5"]
    process = subprocess.Popen(
        [sys.executable, "-m", "sim.mavlink", *arguments], stdout=subprocess.PIPE, text=True, env=os.environ
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "px4 copter, system 5" in line
        with Client(line.split()[-1]) as client:
            beat = client.hear("HEARTBEAT")
            assert (beat.get_srcSystem(), beat.autopilot) == (5, 12)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"autopilot": "betaflight"}, "'betaflight' is not one of ardupilot, px4"),
        ({"autopilot": "px4", "type": "rover"}, "a PX4 rover is not simulated"),
        ({"parameter": ["FOO=1"]}, "no parameter FOO"),
        ({"parameter": ["FOO"]}, "expected NAME=VALUE"),
        ({"home": "here"}, "expected LATITUDE,LONGITUDE,ALTITUDE"),
        ({"fault": ["busy@soon"]}, "with times in s"),
        ({"url": ["udpin:nowhere"]}, "expected udpin, udpout, tcpin or tcp"),
        ({"system_id": 255}, "is not in 1..254"),
    ],
)
def test_what_it_cannot_be_is_one_sentence(options: dict[str, Any], said: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(**options)
    assert str(ended.value).startswith("error: ")
    assert said in str(ended.value)
    assert "\n" not in str(ended.value)
