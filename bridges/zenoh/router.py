"""`searchparty router`: the router that a team in the field meets at."""

# ruff: noqa: PLC0415 - the network is imported when the command runs, not when it is listed

from typing import Annotated

import typer

from agents.cli import MissionArgument


def router(
    mission: MissionArgument,
    listen: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Where to listen, such as tls/0.0.0.0:7447; else the ports of link.endpoints. Repeatable.",
        ),
    ] = None,
) -> None:
    """Run the router of a mission until Ctrl-C. With link.keys it lets in who has the team's keys, under the
    own name only.

    \b
    Example:
      searchparty router mission.toml --listen tls/0.0.0.0:7447
    """
    import signal
    import threading

    import msgspec

    from agents.errors import LinkError
    from agents.mission import mission_file
    from agents.mission.mission import link_of
    from bridges.zenoh.local_router import Router

    link = link_of(mission_file.load(mission))
    endpoints = listen or [_everywhere(endpoint) for endpoint in link.endpoints]
    if not endpoints:
        raise LinkError("nobody could know where this router is: give --listen, or write link.endpoints")
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    with Router(msgspec.structs.replace(link, topology="star", endpoints=endpoints)) as opened:
        guarded = "to those who have the team's keys" if link.keys else "to anybody: there is no link.keys"
        typer.echo(f"open {guarded}, at {', '.join(opened.endpoints)}")
        ended.wait()


def _everywhere(endpoint: str) -> str:
    """The same port on every interface of this computer."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    return f"{protocol}/{'[::]' if host.startswith('[') else '0.0.0.0'}:{port}"
