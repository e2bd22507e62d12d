"""`python -m sim.mavlink`: a simulated MAVLink vehicle as a process."""

import signal
from pathlib import Path
from typing import Annotated

import typer

from agents.errors import MissionError, SearchpartyError
from sim.mavlink.settings import Fault, Settings


def main(
    url: Annotated[list[str] | None, typer.Option(help="KIND:HOST:PORT; may be repeated")] = None,
    autopilot: Annotated[str, typer.Option(help="ardupilot or px4")] = "ardupilot",
    type: Annotated[str, typer.Option(help="copter or rover")] = "copter",
    system_id: Annotated[int, typer.Option(help="1..254")] = 1,
    home: Annotated[str, typer.Option(help="latitude,longitude,altitude in deg, deg, m AMSL")] = "",
    heading: Annotated[float, typer.Option(help="deg from north, clockwise")] = 0.0,
    ready_after: Annotated[float, typer.Option(help="s until the estimator has a position")] = 1.0,
    flight_time: Annotated[float, typer.Option(help="s that a full battery lasts in the air")] = 1200.0,
    parameter: Annotated[list[str] | None, typer.Option(help="NAME=VALUE; may be repeated")] = None,
    fault: Annotated[
        list[str] | None, typer.Option(help="KIND[:VALUE][@START[-END]]; may be repeated")
    ] = None,
    default_streams: Annotated[bool, typer.Option(help="a PX4 streams without being asked")] = False,
    version_1: Annotated[bool, typer.Option(help="MAVLink 1 only")] = False,
    signing_key: Annotated[Path | None, typer.Option(help="file of 32 bytes")] = None,
    speed: Annotated[float, typer.Option(help="vehicle seconds a second")] = 1.0,
    seed: Annotated[int, typer.Option(help="of its faults")] = 0,
) -> None:
    """Simulate a vehicle that speaks MAVLink, until a signal ends it.

    Links are udpout (default: udpout:127.0.0.1:14550), udpin, tcp (to a server) or tcpin (a server).
    """
    from sim.mavlink.serve import Server  # noqa: PLC0415  what is wrong is said before this takes its time

    urls = url or ["udpout:127.0.0.1:14550"]
    try:
        settings = Settings(
            autopilot=_one_of(autopilot, "ardupilot", "px4"),  # type: ignore[arg-type]
            type=_one_of(type, "copter", "rover"),  # type: ignore[arg-type]
            system_id=system_id,
            heading_deg=heading,
            ready_after=ready_after,
            flight_time=flight_time,
            parameters=dict(_assignment(text) for text in parameter or []),
            faults=tuple(Fault.parse(text) for text in fault or []),
            default_streams=default_streams,
            version_1=version_1,
            signing_key=None if signing_key is None else signing_key.read_bytes(),
            seed=seed,
        )
        if home:
            settings = settings.but(home=_home(home))
        server = Server(settings, urls, speed)
    except KeyError as error:
        raise SystemExit(f"error: {error.args[0]}") from None
    except (SearchpartyError, OSError) as error:
        raise SystemExit(f"error: {error}") from None
    for sign in (signal.SIGINT, signal.SIGTERM):
        signal.signal(sign, lambda *_: server.stop())
    clients = ", ".join(server.client_urls)
    print(f"{autopilot} {type}, system {system_id}, at {', '.join(urls)}; clients: {clients}", flush=True)
    server.run()
    server.close()


def _one_of(value: str, *allowed: str) -> str:
    if value not in allowed:
        raise MissionError(f"{value!r} is not one of {', '.join(allowed)}")
    return value


def _assignment(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise MissionError(f"parameter {text!r}: expected NAME=VALUE with a number") from None


def _home(text: str) -> tuple[float, float, float]:
    try:
        latitude, longitude, altitude = (float(part) for part in text.split(","))
    except ValueError:
        raise MissionError(f"home {text!r}: expected LATITUDE,LONGITUDE,ALTITUDE") from None
    return latitude, longitude, altitude


if __name__ == "__main__":
    typer.run(main)
