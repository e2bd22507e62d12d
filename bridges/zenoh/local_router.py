"""Where the processes of a local team meet: a Zenoh router inside the launcher, on a free loopback port."""

import socket
from contextlib import suppress

import zenoh

from agents.errors import LinkError
from agents.mission.mission import LinkTable
from bridges.keys.keyring import ROUTER, credentials
from bridges.zenoh.config import NO_ROUTER, Mode, configuration

_ATTEMPTS = 20
_TAKEN = "os error 98"  # Zenoh's errors are text; this part of it is the operating system's


class Router:
    """The meeting point of a team, for the time of a `with` statement; processes are given `endpoints`.

    star: a router. mesh: a peer that introduces the others to each other and may go away later. Both
    listen on the endpoint of the link table if there is one, else on a free loopback port. router: nothing
    is opened, the endpoints are those of the external router.

    Raises:
        LinkError: on entering, if the port is taken or not ours to take.
    """

    def __init__(self, link: LinkTable) -> None:
        self._link = link
        self._session: zenoh.Session | None = None
        self.endpoints: tuple[str, ...] = ()

    def __repr__(self) -> str:
        state = "open" if self._session is not None else "closed"
        return f"Router({self._link.topology} {','.join(self.endpoints)}, {state})"

    @property
    def endpoint(self) -> str:
        """The first endpoint."""
        return self.endpoints[0]

    def open(self) -> None:
        """Listen. The port of a free endpoint is not reserved before, so that a lost race is just retried."""
        wanted = tuple(self._link.endpoints)
        if self._link.topology == "router" and not wanted:
            raise LinkError(NO_ROUTER)
        if self._link.topology == "router" or (self._link.topology == "mesh" and wanted):
            self.endpoints = wanted
            return
        for attempt in range(_ATTEMPTS):
            endpoints = wanted or (f"{'tls' if self._link.keys else 'tcp'}/127.0.0.1:{_free_port()}",)
            try:
                self._session = self._listen(endpoints)
            except zenoh.ZError as error:
                if not wanted and _TAKEN in str(error) and attempt + 1 < _ATTEMPTS:
                    continue
                raise LinkError(_explanation(endpoints, str(error))) from error
            self.endpoints = endpoints
            return

    def _listen(self, endpoints: tuple[str, ...]) -> zenoh.Session:
        mode: Mode = "router" if self._link.topology == "star" else "peer"
        keys = credentials(self._link.keys, ROUTER) if self._link.keys else None
        return zenoh.open(configuration(self._link, mode, listen=endpoints, keys=keys))

    def close(self) -> None:
        """Stop listening. Safe to call twice."""
        session, self._session = self._session, None
        if session is not None:
            with suppress(zenoh.ZError):
                session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> "Router":
        self.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _explanation(endpoints: tuple[str, ...], error: str) -> str:
    where = " or ".join(endpoints)
    if _TAKEN in error:
        port = " or ".join(endpoint.rpartition(":")[2] for endpoint in endpoints)
        return (
            f"port {port} of {where} is taken: stop what listens there (an earlier run?), "
            "or write another port into the mission's link.endpoints"
        )
    return (
        f"cannot listen on {where}: it must be a free port of this machine, as tcp/127.0.0.1:7447 ({error})"
    )


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
