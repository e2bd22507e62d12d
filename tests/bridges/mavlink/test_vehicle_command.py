"""`searchparty vehicle`: what it tells, and one clear sentence for every bad vehicle, with nothing armed."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from agents import cli
from bridges.mavlink import square, vehicle_command, visit
from bridges.mavlink.dialect import Message, mavlink
from sim.mavlink.serve import Served
from sim.mavlink.settings import Fault, Settings


class Run:
    """One call of the command, in this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys

    def __call__(self, *arguments: str | Path) -> tuple[int, str, str]:
        self._monkeypatch.setattr(sys, "argv", ["searchparty", "vehicle", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        out, err = self._capsys.readouterr()
        return int(caught.value.code or 0), out, err


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    monkeypatch.setattr(visit, "LISTEN", 1.0)
    monkeypatch.setattr(vehicle_command, "SETTLE", 0.8)
    monkeypatch.setattr(square, "STAY", 0.2)
    return Run(monkeypatch, capsys)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def sentence(err: str) -> str:
    """The one that ends it."""
    lines = [line for line in err.splitlines() if line.startswith("searchparty: ")]
    assert len(lines) == 1, err
    return lines[0].removeprefix("searchparty: ")


def settings(**more: object) -> Settings:
    return Settings(ready_after=0.2, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_it_says_who_it_is_what_it_can_do_and_how_it_is(run: Run, autopilot: str) -> None:
    with Served(settings(autopilot=autopilot, system_id=4)) as vehicle:
        status, out, _ = run(vehicle.url, "--json")
        found = json.loads(out)
        assert status == 0
        assert (found["system_id"], found["type"], found["component_id"]) == (4, "copter", 1)
        assert found["autopilot"] == {"ardupilot": "ArduPilot", "px4": "PX4"}[autopilot]
        assert found["version"] == {"ardupilot": "4.6.2", "px4": "1.16.1"}[autopilot]
        assert found["home"] == pytest.approx((47.397742, 8.545594, 488.0), abs=1e-4)
        assert found["battery"] == 1.0
        assert "set position target local ned" in found["capabilities"]
        assert {"ardupilot": "GUIDED", "px4": "OFFBOARD"}[autopilot] in found["modes"]
        assert found["rates_hz"]["LOCAL_POSITION_NED"] == pytest.approx(10.0, abs=4.0)
        assert {one["cause"] for one in found["failsafes"]} >= {"ground link", "setpoints", "fence"}
        assert found["link_quality"] > 0.9
        _, table, _ = run(vehicle.url, "--info")
        assert found["version"] in table
        assert not vehicle.ask(lambda pilot: pilot.armed)


def test_the_arm_check_tells_what_stops_it_in_the_autopilot_s_words(run: Run) -> None:
    with Served(settings()) as vehicle:
        status, out, _ = run(vehicle.url, "--arm-check", "--json")
        assert (status, json.loads(out)["ok"]) == (0, True)
        assert any("FS_GCS_ENABLE = 0" in warning for warning in json.loads(out)["warnings"])
    with Served(settings(faults=(Fault("refuse_arming", value="Arm: Gyros inconsistent"),))) as vehicle:
        status, out, _ = run(vehicle.url, "--arm-check")
        assert status == 1
        assert "Gyros inconsistent" in out
        assert "would not be armed" in out


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("no_position", "its estimator"),
        ("nan_telemetry", "has not reported a local position"),
        ("bad_estimate", "estimator"),
        ("battery", "battery at 5%"),
    ],
)
def test_a_vehicle_that_is_not_well_is_not_flown(run: Run, fault: str, words: str) -> None:
    value = 5.0 if fault == "battery" else 1.0
    with Served(settings(faults=(Fault(fault, value=value),))) as vehicle:  # type: ignore[arg-type]
        status, out, _ = run(vehicle.url, "--arm-check")
        assert status == 1
        assert words in out
        assert not vehicle.ask(lambda pilot: pilot.armed)


def test_numbers_that_are_none_are_told(run: Run) -> None:
    with Served(settings(faults=(Fault("nan_telemetry"),))) as vehicle:
        _, out, _ = run(vehicle.url, "--arm-check")
        assert "numbers that are none (NaN)" in out


@pytest.mark.parametrize(
    ("made", "options", "status", "words"),
    [
        ({"system_id": 3}, ("--system-id", "7"), 3, "vehicles heard there: 3 (copter); correct --system-id"),
        ({"version_1": True}, (), 3, "speaks only MAVLink 1"),
        ({"type": "rover"}, ("--type", "copter"), 3, "is a rover, but you expect a copter"),
        ({"autopilot": "px4"}, ("--autopilot", "ardupilot"), 3, "flies with px4, but you expect ardupilot"),
        (
            {"signing_key": bytes(32)},
            (),
            3,
            "signs its messages and would not hear ours; name the key file with",
        ),
        ({"faults": (Fault("deaf"),)}, (), 3, "is heard at"),
        ({"faults": (Fault("mute"),)}, (), 3, "no vehicle is heard"),
        ({"faults": (Fault("no_heartbeat"),)}, (), 3, "no vehicle is heard"),
    ],
)
def test_another_vehicle_than_expected_is_one_sentence_with_nothing_armed(
    run: Run, made: dict[str, object], options: tuple[str, ...], status: int, words: str
) -> None:
    with Served(settings(**made)) as vehicle:
        found, _, err = run(vehicle.url, "--fly-square", "5", "--yes", "--patience", "2.5", *options)
        assert found == status
        assert words in sentence(err)
        assert not vehicle.ask(lambda pilot: pilot.armed)


def test_a_wrong_key_is_told(run: Run, tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("11" * 32)
    key.chmod(0o600)
    with Served(settings(signing_key=bytes(32))) as vehicle:
        status, _, err = run(vehicle.url, "--keys", key, "--patience", "2")
        assert status == 3
        assert "compare the keys" in sentence(err)


@pytest.mark.parametrize(
    ("url", "status", "words"),
    [
        ("nonsense", 2, "is no MAVLink address"),
        ("tcp:127.0.0.1:1", 3, "start the vehicle or its router there"),
        ("udpin:127.0.0.1:{free}", 3, "is it switched on, and does it send there?"),
        ("serial:/dev/nothing:57600", 3, "is it plugged in"),
    ],
)
def test_where_no_vehicle_is_one_sentence_says_what_to_do(
    run: Run, url: str, status: int, words: str
) -> None:
    found, _, err = run(url.format(free=free_port()), "--patience", "1")
    assert found == status
    assert words in sentence(err)


def test_garbage_is_told_from_silence(run: Run) -> None:
    port, over = free_port(), threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:

        def shout() -> None:
            while not over.wait(0.05):
                peer.sendto(b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9*47\r\n", ("127.0.0.1", port))

        thread = threading.Thread(target=shout)
        thread.start()
        try:
            status, _, err = run(f"udpin:127.0.0.1:{port}", "--patience", "1")
        finally:
            over.set()
            thread.join()
    assert status == 3
    assert "no MAVLink frame is among them" in sentence(err)


def test_two_vehicles_with_one_id_are_told_before_any_is_armed(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(visit, "LISTEN", 3.5)
    port = free_port()
    url = f"udpout:127.0.0.1:{port}"
    with Served(settings(), url) as one, Served(settings(clock_offset=500.0), url) as two:
        status, _, err = run(f"udpin:127.0.0.1:{port}", "--fly-square", "5", "--yes")
        assert status == 3
        assert "two vehicles with system id 1" in sentence(err)
        assert not one.ask(lambda pilot: pilot.armed)
        assert not two.ask(lambda pilot: pilot.armed)


def _plane(port: int) -> Message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3
    )


def _station(port: int) -> Message:
    return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 3, 3)


@pytest.mark.parametrize(
    ("heartbeat", "component", "words"),
    [(_plane, 1, "only these are flown"), (_station, 190, "only a ground station (system 9)")],
)
def test_what_is_no_copter_and_no_rover_is_named(
    run: Run, heartbeat: type, component: int, words: str
) -> None:
    port = free_port()
    with speaking(port, heartbeat(port), component):  # type: ignore[call-arg]
        status, _, err = run(f"udpin:127.0.0.1:{port}", "--patience", "2.5")
    assert status == 3
    assert words in sentence(err)


@contextmanager
def speaking(port: int, message: Message, component: int) -> Iterator[None]:
    """A peer that says one thing again and again."""
    packer, over = mavlink.MAVLink(None, 9, component), threading.Event()

    def speak() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            while not over.wait(0.2):
                packer.seq = (packer.seq + 1) % 256
                peer.sendto(message.pack(packer), ("127.0.0.1", port))

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_it_flies_the_square_and_says_how_near(run: Run) -> None:
    with Served(settings(), speed=4.0) as vehicle:
        status, out, err = run(vehicle.url, "--fly-square", "4", "--height", "2", "--yes")
        assert status == 0, (out, err)
        assert out.count("reached, 0.") == 4
        assert "down and disarmed" in out
        assert not vehicle.ask(lambda pilot: pilot.armed)


def test_nothing_is_armed_unasked(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    with Served(settings()) as vehicle:
        monkeypatch.setattr("sys.stdin", open(os.devnull))  # noqa: SIM115 - closed with the process
        status, _, err = run(vehicle.url, "--fly-square", "5")
        assert status == 2
        assert "give --yes" in sentence(err)
        assert not vehicle.ask(lambda pilot: pilot.armed)


@pytest.mark.parametrize(
    "options",
    [("--info", "--arm-check"), ("--fly-square", "5", "--json"), ("--fence", "quickstart", "--download")],
)
def test_what_does_not_go_together_is_said_before_anything_is_opened(
    run: Run, options: tuple[str, ...]
) -> None:
    status, _, err = run("tcp:127.0.0.1:1", *options)
    assert status == 2
    assert options[0] in sentence(err)


@pytest.mark.processes
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGHUP])
def test_an_interrupted_flight_ends_on_the_ground(sign: signal.Signals) -> None:
    with Served(settings(), speed=4.0) as vehicle:
        call = [sys.executable, "-m", "agents", "vehicle", vehicle.url, "--fly-square", "20", "--yes"]
        process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            assert vehicle.wait_for(lambda pilot: -pilot.body.position[2] > 2.0, 40.0)
            process.send_signal(sign)
            time.sleep(0.3)
            process.send_signal(sign)  # impatience changes nothing
            out, err = process.communicate(timeout=60.0)
        finally:
            process.kill()
            process.wait()
        assert process.returncode == 1
        assert "it is told to land" in err
        assert "interrupted; it is down and disarmed" in err, (out, err)
        assert not vehicle.ask(lambda pilot: pilot.armed)
