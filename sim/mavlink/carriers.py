"""The sockets of a simulated vehicle: UDP and TCP, as a server or as a client.

`udpout:HOST:PORT` sends there (PX4's simulator does) and answers whoever sends to it; `udpin:HOST:PORT`
waits for peers; `tcpin:HOST:PORT` listens (ArduPilot's simulator does) to several clients at once;
`tcp:HOST:PORT` connects and reconnects. Nothing here blocks, and no dead peer is an error.
"""

import contextlib
import selectors
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable

from agents.errors import LinkError, MissionError

Address = tuple[str, int]
RECONNECT = 0.5  # s
QUEUE = 1 << 18  # bytes that wait for a slow TCP client before it is cut off


class Carrier(ABC):
    """Carries bytes between a vehicle and its peers."""

    lost: Callable[[object], None]  # told of a peer whose connection is gone

    def __init__(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector
        self.lost = lambda peer: None

    @abstractmethod
    def client_url(self) -> str:
        """By what URL a client reaches it."""

    @abstractmethod
    def receive(self, ready: socket.socket, now: float) -> list[tuple[object, bytes]]:
        """What came in on a socket that is ready."""

    @abstractmethod
    def send(self, frames: list[bytes], now: float) -> None:
        """To all peers."""

    @abstractmethod
    def close(self) -> None: ...

    def _watch(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        self._selector.register(sock, selectors.EVENT_READ, self)

    def _unwatch(self, sock: socket.socket) -> None:
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(sock)
        sock.close()


class Udp(Carrier):
    """Datagrams, a frame each."""

    def __init__(self, selector: selectors.BaseSelector, address: Address, bind: bool) -> None:
        super().__init__(selector)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._peers: dict[Address, None] = {} if bind else {address: None}
        self._socket.bind(address if bind else ("127.0.0.1" if address[0] == "127.0.0.1" else "", 0))
        self._watch(self._socket)

    def client_url(self) -> str:
        host, port = self._socket.getsockname()
        return f"udpout:{'127.0.0.1' if host == '0.0.0.0' else host}:{port}"

    def receive(self, ready: socket.socket, now: float) -> list[tuple[object, bytes]]:
        heard: list[tuple[object, bytes]] = []
        while len(heard) < 200:
            try:
                data, peer = ready.recvfrom(65536)
            except OSError:
                break
            self._peers[peer] = None
            heard.append((peer, data))
        return heard

    def send(self, frames: list[bytes], now: float) -> None:
        for peer in self._peers:
            for frame in frames:
                with contextlib.suppress(OSError):
                    self._socket.sendto(frame, peer)

    def close(self) -> None:
        self._unwatch(self._socket)


class Tcp(Carrier):
    """Connections, accepted or made."""

    def __init__(self, selector: selectors.BaseSelector, address: Address, listen: bool) -> None:
        super().__init__(selector)
        self._address = address
        self._server: socket.socket | None = None
        self._clients: dict[socket.socket, bytearray] = {}
        self._next_try = 0.0
        if listen:
            self._server = socket.create_server(address)
            self._watch(self._server)

    def client_url(self) -> str:
        if self._server is None:
            return f"tcpin:{self._address[0]}:{self._address[1]}"
        host, port = self._server.getsockname()[:2]
        return f"tcp:{'127.0.0.1' if host == '0.0.0.0' else host}:{port}"

    def receive(self, ready: socket.socket, now: float) -> list[tuple[object, bytes]]:
        if ready is self._server:
            with contextlib.suppress(OSError):
                self._take(self._server.accept()[0])
            return []
        try:
            data = ready.recv(65536)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._drop(ready)
            return []
        return [(ready, data)]

    def send(self, frames: list[bytes], now: float) -> None:
        if self._server is None and not self._clients and now >= self._next_try:
            self._next_try = now + RECONNECT
            with contextlib.suppress(OSError):
                self._take(socket.create_connection(self._address, timeout=0.2))
        data = b"".join(frames)
        for client, waiting in list(self._clients.items()):
            waiting.extend(data)
            try:
                while waiting:
                    del waiting[: client.send(waiting)]
            except BlockingIOError:
                if len(waiting) > QUEUE:
                    self._drop(client)
            except OSError:
                self._drop(client)

    def close(self) -> None:
        for client in list(self._clients):
            self._drop(client)
        if self._server is not None:
            self._unwatch(self._server)

    def _take(self, client: socket.socket) -> None:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._watch(client)
        self._clients[client] = bytearray()

    def _drop(self, client: socket.socket) -> None:
        self._clients.pop(client, None)
        self._unwatch(client)
        self.lost(client)


def carrier_of(url: str, selector: selectors.BaseSelector) -> Carrier:
    """The carrier of a URL.

    Raises:
        MissionError: if it is none.
        LinkError: if its port cannot be had.
    """
    kind, _, rest = url.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in ("udpin", "udpout", "tcpin", "tcp") or not host or not port.isdigit():
        raise MissionError(
            f"no such link {url!r}; expected udpin, udpout, tcpin or tcp, as in udpout:127.0.0.1:14550"
        )
    address = (host, int(port))
    try:
        if kind.startswith("udp"):
            return Udp(selector, address, bind=kind == "udpin")
        return Tcp(selector, address, listen=kind == "tcpin")
    except OSError as error:
        raise LinkError(
            f"cannot open {url}: {error.strerror}; choose another port, or 0 for a free one"
        ) from None
