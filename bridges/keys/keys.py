"""`searchparty keys`: the certificates of a guarded team, and what its routers let each of them do.

What they are and where they lie is told by bridges.keys.workshop and docs/security.md.
"""

# ruff: noqa: PLC0415 - cryptography is imported when the command runs, not when it is listed

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from agents.cli import MissionArgument

if TYPE_CHECKING:
    from agents.mission.mission import Mission
    from bridges.keys.workshop import Workshop


def keys(
    mission: MissionArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to; else link.keys, or keys/ beside the mission."),
    ] = None,
    hosts: Annotated[
        list[str] | None,
        typer.Option(metavar="HOST", help="A name or address at which the router is reached. Repeatable."),
    ] = None,
    also: Annotated[
        list[str] | None,
        typer.Option(metavar="ROLE:NAME", help="One more process, such as operator:anna or fusion:fusion2."),
    ] = None,
    renew: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="A new certificate; the old one is let in no more. all: everybody."
        ),
    ] = None,
    revoke: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Let this process in no more, until it is renewed. Repeatable."),
    ] = None,
    days: Annotated[float, typer.Option(min=0.0, help="How long new certificates are valid.")] = 365.0,
) -> None:
    """Make the certificates of a team, and the access list of its router.

    What exists already is kept. The router must be started again to know of renewed and revoked certificates.

    \b
    Examples:
      searchparty keys mission.toml --hosts 192.0.2.1 --hosts base.local
      searchparty keys mission.toml --renew r2
      searchparty keys mission.toml --also operator:anna --also fusion:fusion2
    """
    from agents.mission import mission_file
    from agents.mission.tables import resolve_path
    from bridges.keys.workshop import Workshop

    loaded = mission_file.load(mission)
    directory = out if out is not None else resolve_path(loaded.directory, loaded.link.keys or "keys")
    workshop = Workshop.open(directory, loaded, datetime.now(UTC), days)
    for text in also or []:
        workshop.enlist(*_role_and_name(text, loaded))
    for name in revoke or []:
        workshop.revoke(name)
    names = list(workshop.members) if "all" in (renew or []) else renew or []
    for name in names:
        workshop.renew(name)
    made = workshop.issue(hosts or [])
    workshop.write()
    _report(workshop, made, loaded)


def _role_and_name(text: str, mission: "Mission") -> tuple[str, str]:
    import re

    from agents.errors import MissionError
    from agents.wire.roles import ROLES

    role, colon, name = text.partition(":")
    if not colon or role not in ROLES or not re.fullmatch(r"[A-Za-z0-9_.-]{1,64}", name):
        raise MissionError(f"--also: found {text!r}, allowed is ROLE:NAME with a role of {', '.join(ROLES)}")
    if role == "robot" and name not in {robot.id for robot in mission.robots}:
        raise MissionError(f"--also: the mission has no robot {name!r}")
    return role, name


def _report(workshop: "Workshop", made: list[str], mission: "Mission") -> None:
    from bridges.keys.certificates import hosts_of
    from bridges.keys.keyring import ROUTER
    from bridges.keys.workshop import AUTHORITY_KEY, HOME

    directory = workshop.directory
    if made:
        found = [workshop.certificate(name) for name in made]
        expiry = min(certificate.not_valid_after_utc for certificate in found if certificate is not None)
        typer.echo(f"certificates valid until {expiry:%Y-%m-%d}: {', '.join(made)}")
    else:
        typer.echo("every certificate is there already; --renew NAME makes a new one")
    gone = [name for name, member in workshop.members.items() if member.revoked]
    if gone:
        typer.echo(f"let in no more: {', '.join(gone)}")
    router = workshop.certificate(ROUTER)
    if router is not None:
        typer.echo(f"the router is reached at {', '.join(hosts_of(router))}")
    typer.echo(f"bring {directory}/NAME to the computer of each NAME, and {directory}/router to the router's")
    typer.echo(f"keep {directory}/{HOME} to yourself: whoever has {AUTHORITY_KEY} can let anybody in")
    if not mission.link.keys:
        typer.echo('the mission does not use them yet: write keys = "keys" into its [link]')
