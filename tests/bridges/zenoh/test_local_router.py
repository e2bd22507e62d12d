"""Where the processes of a local team meet."""

import socket

import pytest

from agents.errors import LinkError
from agents.mission.mission import LinkTable
from bridges.zenoh import local_router as zenoh_router
from bridges.zenoh.local_router import Router


def test_routers_of_two_teams_get_ports_of_their_own() -> None:
    with Router(LinkTable()) as one, Router(LinkTable()) as other:
        assert one.endpoint != other.endpoint
        assert one.endpoint.startswith("tcp/127.0.0.1:")


def test_a_port_lost_to_somebody_else_is_replaced_by_another(monkeypatch: pytest.MonkeyPatch) -> None:
    real = zenoh_router._free_port
    with socket.create_server(("127.0.0.1", 0)) as taken:
        offers = iter([taken.getsockname()[1]])
        monkeypatch.setattr(zenoh_router, "_free_port", lambda: next(offers, None) or real())
        with Router(LinkTable()) as router:
            assert router.endpoint != f"tcp/127.0.0.1:{taken.getsockname()[1]}"


def test_a_busy_port_is_an_error_that_names_it_and_says_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        link = LinkTable(endpoints=[f"tcp/127.0.0.1:{port}"])
        with pytest.raises(LinkError, match=f"port {port} .*is taken: stop what listens there"):
            Router(link).open()


def test_an_address_of_another_machine_is_an_error() -> None:
    with pytest.raises(LinkError, match=r"192\.0\.2\.1:7447.*this machine"):
        Router(LinkTable(endpoints=["tcp/192.0.2.1:7447"])).open()


def test_an_external_router_is_passed_on() -> None:
    with Router(LinkTable(topology="router", endpoints=["tcp/192.0.2.1:7447"])) as router:
        assert router.endpoints == ("tcp/192.0.2.1:7447",)


def test_an_external_router_must_be_named() -> None:
    with pytest.raises(LinkError, match=r"link\.endpoints"):
        Router(LinkTable(topology="router")).open()


def test_close_frees_the_port_and_may_be_called_twice() -> None:
    with Router(LinkTable()) as router:
        port = int(router.endpoint.rpartition(":")[2])
        router.close()
        router.close()
        socket.create_server(("127.0.0.1", port)).close()
