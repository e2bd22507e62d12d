"""What carries bytes: UDP, TCP and serial lines, all non-blocking. Reconnecting is the port's business."""

import errno
import os
import socket
import termios
import tty
from abc import ABC, abstractmethod
from collections import OrderedDict
from contextlib import suppress
from typing import Any

from bridges.mavlink.url import Endpoint

CHUNK = 65536
PEERS = 32  # addresses that a listening UDP socket answers
BACKLOG = 65536  # bytes that wait for a slow stream before whole frames are dropped


class Carrier(ABC):
    """One open line. Every method may raise OSError: the line is lost, close it."""

    datagrams = False  # whether reads hold whole frames
    watched = True  # silence means that the line is dead

    @abstractmethod
    def fileno(self) -> int:
        """What to wait for."""

    @abstractmethod
    def read(self) -> list[tuple[bytes, object]]:
        """What came, each with the peer it came from; never waits."""

    @abstractmethod
    def write(self, data: bytes, peer: object = None) -> bool:
        """Send a frame to one peer, or to all; False: it was dropped because the line is too slow."""

    @abstractmethod
    def close(self) -> None:
        """Never raises."""

    def flush(self) -> bool:
        """Send what waits; True when nothing does any more."""
        return True


class Udp(Carrier):
    """`udpin` answers everybody it hears; `udpout` speaks to one address."""

    datagrams = True
    watched = False

    def __init__(self, endpoint: Endpoint) -> None:
        info = socket.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(info[0], socket.SOCK_DGRAM)
        self._peers: OrderedDict[Any, None] = OrderedDict()
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            if endpoint.kind == "udpin":
                self._socket.bind(info[4])
                self._target = None
            else:
                self._target = info[4]
                self._socket.connect(info[4])
        except OSError:
            self._socket.close()
            raise

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> list[tuple[bytes, object]]:
        found: list[tuple[bytes, object]] = []
        for _ in range(256):  # a flood must not keep us from sending
            try:
                data, peer = self._socket.recvfrom(CHUNK)
            except (BlockingIOError, InterruptedError):
                break
            except ConnectionError:  # nobody listens there yet
                continue
            self._peers[peer] = None
            self._peers.move_to_end(peer)
            if len(self._peers) > PEERS:
                self._peers.popitem(last=False)
            found.append((data, peer))
        return found

    def write(self, data: bytes, peer: object = None) -> bool:
        try:
            if self._target is not None:
                self._socket.send(data)
            else:
                addresses: list[Any] = [peer] if peer is not None else list(self._peers)
                for address in addresses:
                    self._socket.sendto(data, address)
        except (BlockingIOError, ConnectionError):
            return False
        except OSError as error:
            if error.errno in (errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN, errno.EPERM):
                return False
            raise
        return True

    def close(self) -> None:
        self._socket.close()


class Stream(Carrier):
    """A line without borders: what does not go out at once waits; when too much does, frames are dropped."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def write(self, data: bytes, peer: object = None) -> bool:
        if len(self._waiting) + len(data) > BACKLOG:
            self.flush()
            if len(self._waiting) + len(data) > BACKLOG:
                return False
        self._waiting += data
        self.flush()
        return True

    def flush(self) -> bool:
        while self._waiting:
            try:
                sent = self._send(bytes(self._waiting))
            except (BlockingIOError, InterruptedError):
                return False
            del self._waiting[:sent]
        return True

    @abstractmethod
    def _send(self, data: bytes) -> int:
        """How many bytes went out."""


class Tcp(Stream):
    """A connection, made by us or (`tcpin`) by the first who calls; the newest caller replaces the last."""

    def __init__(self, endpoint: Endpoint, patience: float) -> None:
        super().__init__()
        self._line: socket.socket | None = None
        self._door: socket.socket | None = None
        if endpoint.kind == "tcp":
            self._line = socket.create_connection((endpoint.host, endpoint.port), timeout=patience)
            self._ready(self._line)
        else:
            self.watched = False
            self._door = socket.create_server((endpoint.host, endpoint.port))
            self._door.setblocking(False)

    def fileno(self) -> int:
        line = self._line or self._door
        assert line is not None
        return line.fileno()

    def read(self) -> list[tuple[bytes, object]]:
        if self._door is not None:
            with suppress(BlockingIOError):
                caller, _ = self._door.accept()
                self._hang_up()
                self._line = caller
                self._ready(caller)
        if self._line is None:
            return []
        try:
            data = self._line.recv(CHUNK)
        except (BlockingIOError, InterruptedError):
            return []
        except OSError:
            data = b""
        if data:
            return [(data, self._line.fileno())]
        if self._door is None:
            raise ConnectionResetError("the other side closed the connection")
        self._hang_up()
        return []

    def close(self) -> None:
        self._hang_up()
        if self._door is not None:
            self._door.close()

    def write(self, data: bytes, peer: object = None) -> bool:
        return self._line is not None and super().write(data, peer)

    def _send(self, data: bytes) -> int:
        if self._line is None:
            return len(data)
        try:
            return self._line.send(data)
        except ConnectionError:
            if self._door is None:
                raise
            self._hang_up()
            return len(data)

    def _ready(self, line: socket.socket) -> None:
        line.setblocking(False)
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _hang_up(self) -> None:
        if self._line is not None:
            self._line.close()
        self._line = None
        self._waiting.clear()


class Serial(Stream):
    """A serial device, raw, 8N1, without flow control."""

    def __init__(self, endpoint: Endpoint) -> None:
        super().__init__()
        speed = getattr(termios, f"B{endpoint.port}", None)
        if speed is None:
            raise OSError(errno.EINVAL, f"{endpoint.port} baud is no rate of this system", endpoint.host)
        self._fd = os.open(endpoint.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(self._fd)
            modes = termios.tcgetattr(self._fd)
            modes[2] = (modes[2] | termios.CLOCAL | termios.CREAD) & ~(termios.CRTSCTS | termios.CSTOPB)
            modes[4] = modes[5] = speed
            termios.tcsetattr(self._fd, termios.TCSANOW, modes)
        except (OSError, termios.error) as error:
            os.close(self._fd)
            raise OSError(errno.ENOTTY, f"no serial line: {error}", endpoint.host) from error

    def fileno(self) -> int:
        return self._fd

    def read(self) -> list[tuple[bytes, object]]:
        try:
            data = os.read(self._fd, CHUNK)
        except (BlockingIOError, InterruptedError):
            return []
        if not data:
            raise ConnectionResetError("the serial device is gone")
        return [(data, self._fd)]

    def close(self) -> None:
        with suppress(OSError):
            os.close(self._fd)

    def _send(self, data: bytes) -> int:
        return os.write(self._fd, data)


def open_carrier(endpoint: Endpoint, patience: float = 1.0) -> Carrier:
    """Open a line; a TCP connection is waited for at most `patience` seconds.

    Raises:
        OSError: if it cannot be had now.
    """
    if endpoint.kind.startswith("udp"):
        return Udp(endpoint)
    if endpoint.kind.startswith("tcp"):
        return Tcp(endpoint, patience)
    return Serial(endpoint)
