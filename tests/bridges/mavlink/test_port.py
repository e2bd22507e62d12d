"""Links over real sockets of this machine."""

import os
import resource
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from bridges.mavlink.dialect import mavlink
from bridges.mavlink.link import QUEUE, Link
from bridges.mavlink.port import LONGEST_PAUSE, Port
from bridges.mavlink.wire import Wire

BEAT = mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 4, 3)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def free(kind: int = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def link(stack: ExitStack, url: str, system: int = 1) -> Link:
    return stack.enter_context(Link(url, (system, 1)))


def until(condition: Callable[[], bool], seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return condition()


def speak(sender: Link, hearer: Link) -> bool:
    """Whether a heartbeat arrives, sent again and again."""

    def arrived() -> bool:
        sender.send(BEAT)
        return bool(hearer.drain())

    return until(arrived)


@pytest.mark.parametrize(("near", "far"), [("udpin", "udpout"), ("tcp", "tcpin"), ("tcpin", "tcp")])
def test_both_sides_hear_each_other(stack: ExitStack, near: str, far: str) -> None:
    port = free()
    one, other = link(stack, f"{near}:127.0.0.1:{port}"), link(stack, f"{far}:127.0.0.1:{port}", 2)
    assert speak(other, one)
    assert speak(one, other)


def test_a_serial_line_carries_messages(stack: ExitStack) -> None:
    ours, theirs = os.openpty()
    stack.callback(os.close, ours)
    stack.callback(os.close, theirs)
    line = link(stack, f"serial:{os.ttyname(theirs)}:115200")
    assert until(lambda: line.state().open)
    line.send(BEAT)
    found = bytearray()

    def whole() -> bool:
        found.extend(os.read(ours, 100))
        return len(found) >= 10 + 9 + 2

    assert until(whole)
    (message,) = mavlink.MAVLink(None).parse_buffer(found)
    assert message.custom_mode == 4
    os.write(ours, bytes(found))
    assert until(lambda: bool(line.drain()))


def test_a_tcp_link_comes_back_after_its_server_and_never_pauses_for_longer_than_a_second(
    stack: ExitStack,
) -> None:
    port = free(socket.SOCK_STREAM)
    client = link(stack, f"tcp:127.0.0.1:{port}")
    with Link(f"tcpin:127.0.0.1:{port}", (2, 1)) as server:
        assert speak(server, client)
    assert until(lambda: not client.state().open)
    time.sleep(1.0)
    server = link(stack, f"tcpin:127.0.0.1:{port}", 2)
    assert until(lambda: server.state().open)
    assert speak(server, client)
    assert client._port._pause <= LONGEST_PAUSE == 1.0  # benchmarks/bench_mavlink.py measures how soon


def test_a_dead_tcp_link_costs_next_to_nothing(stack: ExitStack) -> None:
    client = link(stack, f"tcp:127.0.0.1:{free(socket.SOCK_STREAM)}")
    before = resource.getrusage(resource.RUSAGE_SELF)
    time.sleep(1.5)
    after = resource.getrusage(resource.RUSAGE_SELF)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 0.3
    assert 2 <= client.counters["failed_opens"] <= 8
    assert "refused" in client.state().trouble


def test_two_vehicles_on_one_listening_socket_get_each_their_own_messages(stack: ExitStack) -> None:
    port = free()
    robot = link(stack, f"udpin:127.0.0.1:{port}", 9)
    vehicles = {system: link(stack, f"udpout:127.0.0.1:{port}", system) for system in (1, 2)}
    assert all(speak(vehicle, robot) for vehicle in vehicles.values())
    for vehicle in vehicles.values():
        vehicle.drain()
    robot.send(mavlink.MAVLink_param_request_read_message(2, 1, b"FENCE_ENABLE", -1))
    assert until(lambda: "PARAM_REQUEST_READ" in [m.get_type() for m in vehicles[2].drain()])
    assert not vehicles[1].drain()


def test_one_id_from_two_addresses_at_the_same_time_is_noticed_a_restart_is_not() -> None:
    now = [10.0]
    port = Port("udpin:127.0.0.1:9", clock=lambda: now[0])
    wire = Wire((1, 1))
    (beat,) = wire.parse(wire.pack(BEAT))
    for peer in ["a", "a", "b", "b", "b"]:
        port._route(beat, peer)
        now[0] += 0.5
    assert not port.state().doubled
    for peer in ["a", "b", "a", "b"]:
        port._route(beat, peer)
        now[0] += 0.5
    assert port.state().doubled == {1}
    port.close()


def test_a_flood_does_not_keep_a_link_from_sending_and_its_queues_are_bounded(stack: ExitStack) -> None:
    port = free()
    robot, vehicle = link(stack, f"udpin:127.0.0.1:{port}"), link(stack, f"udpout:127.0.0.1:{port}", 2)
    assert speak(vehicle, robot)
    flood = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stack.callback(flood.close)
    frame = bytes(BEAT.pack(mavlink.MAVLink(None, 3, 1)))
    for _ in range(4 * QUEUE):
        flood.sendto(frame, ("127.0.0.1", port))
    vehicle.drain()
    robot.send(BEAT)
    assert until(lambda: bool(vehicle.drain()))
    assert len(robot.drain()) <= QUEUE


def test_a_link_ends_with_its_thread() -> None:
    one = Link("tcp:127.0.0.1:9")
    one.start()
    one.close()
    assert not one._thread.is_alive()
