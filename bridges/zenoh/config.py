"""The Zenoh settings of one process: every setting that differs from Zenoh's own, and why."""

import json
from typing import Any, Literal

import zenoh

from agents.errors import LinkError
from agents.mission.mission import LinkTable
from bridges.keys.keyring import ACCESS, Credentials

Mode = Literal["client", "peer", "router"]

NO_ROUTER = "the mission names no router: set link.endpoints to where it listens, as tcp/HOST:PORT"
WAIT_US = 10_000  # that a put may wait for a free batch; Zenoh's own is a tenth of that
RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}


def configuration(
    link: LinkTable,
    mode: Mode,
    *,
    connect: tuple[str, ...] = (),
    listen: tuple[str, ...] = (),
    listen_if_free: bool = False,
    keys: Credentials | None = None,
) -> zenoh.Config:
    """The configuration of a session in `mode`, for the endpoints given.

    An endpoint to listen on that is not free is an error, or, with `listen_if_free`, left to who has it.
    With `keys` links are TLS, and both ends show certificates; a router then holds all to its access list.

    Raises:
        LinkError: if an endpoint is no endpoint.
    """
    lease_ms = int(link.lease_s * 1000)
    settings: dict[str, Any] = {
        "mode": mode,
        "connect/endpoints": list(connect),
        "connect/retry": RETRY,
        "listen/endpoints": list(listen),
        # Teams are told where to meet: two teams on one network must not find each other by accident.
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        # Costs start-up time and a pool of 16 MiB, and gains nothing at our message sizes.
        "transport/shared_memory/enabled": False,
        # How long a silent process (stopped, unplugged) still counts as alive. Four keep-alives per lease.
        "transport/link/tx/lease": lease_ms,
        # An endpoint that accepts the connection but does not speak Zenoh must not hold us for 10 s.
        "transport/unicast/open_timeout": 2000,
        # A process that waits for a core has no free batch for a while; only after that a message is dropped.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": WAIT_US,
        # What may not be dropped (declarations, replies) waits this long for a receiver that does not
        # read, in a router at the cost of everybody else; Zenoh's 5 s would freeze a whole team.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": lease_ms * 1000 // 2,
    }
    if mode == "router":
        settings["scouting/delay"] = 0  # half a second of waiting for others, though nobody can be there yet
    if mode == "client":
        settings["connect/timeout_ms"] = 2000
    if listen_if_free:
        # Once, and not again: while Zenoh waits for a port, closing the session hangs for ten seconds.
        settings["listen/timeout_ms"] = 0
        settings["listen/exit_on_failure"] = False
    if keys is not None:
        settings |= _guarded(keys, mode)
    config = zenoh.Config()
    for name, value in settings.items():
        try:
            config.insert_json5(name, json.dumps(value))
        except zenoh.ZError as error:
            raise LinkError(
                f"{json.dumps(value)} is not a valid {name}: "
                "write endpoints as tcp/HOST:PORT in the mission's link.endpoints"
            ) from error
    return config


def free_port_endpoint(endpoints: tuple[str, ...]) -> str:
    """Where a peer of a mesh listens: any free port, on loopback if all meeting points are there."""
    hosts = [endpoint.partition("/")[2].rpartition(":")[0] for endpoint in endpoints]
    if all(host in ("localhost", "[::1]") or host.startswith("127.") for host in hosts):
        return "tcp/127.0.0.1:0"
    return "tcp/[::]:0" if any(host.startswith("[") for host in hosts) else "tcp/0.0.0.0:0"


def _guarded(keys: Credentials, mode: Mode) -> dict[str, Any]:
    end = "listen" if mode == "router" else "connect"
    tls = {
        "root_ca_certificate": str(keys.authority),
        "enable_mtls": True,
        f"{end}_certificate": str(keys.certificate),
        f"{end}_private_key": str(keys.key),
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    settings: dict[str, Any] = {"transport/link/tls": tls, "transport/link/protocols": ["tls"]}
    if mode == "router":
        settings["access_control"] = json.loads((keys.certificate.parent / ACCESS).read_text())
    return settings
