"""`searchparty observe`: an operator tells a running team what is where, and hears what became of it."""

# ruff: noqa: PLC0415 - the network and numpy are imported when the command runs, not when it is listed

from typing import TYPE_CHECKING, Annotated, Any

import typer

from agents.cli import Connect, MissionArgument

if TYPE_CHECKING:
    from agents.mission.mission import Mission, StatementTable

JOIN_S = 10.0  # wall time within which the fusion must be heard
SETTLE_S = 1.0  # wall time from the acknowledgement to the answer in words, which may have been lost


def observe(
    mission: MissionArgument,
    relation: Annotated[
        str,
        typer.Argument(help="near, around, far; inside, outside; in_front, behind, left or right."),
    ],
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y",
            help="Where, m: a place; or the corners of a region; or the ends of a line. Repeatable.",
        ),
    ] = None,
    nothing: Annotated[
        bool, typer.Option("--not", help="Nothing is there; with --target: the target is not there.")
    ] = False,
    target: Annotated[
        str, typer.Option(metavar="NAME", help="Which target; else something, or nothing.")
    ] = "",
    radius: Annotated[float, typer.Option(metavar="M", help="near reaches this far.")] = 10.0,
    outer: Annotated[
        float | None, typer.Option(metavar="M", help="around reaches this far; else twice --radius.")
    ] = None,
    yaw: Annotated[
        float, typer.Option(metavar="DEG", help="Where the front of a place is, counter-clockwise from east.")
    ] = 0.0,
    reach: Annotated[
        float | None, typer.Option(metavar="M", help="A side goes no further than this.")
    ] = None,
    slope: Annotated[
        float, typer.Option(metavar="S", help="Of borders, 1/m: 4.4 / S metres from 10 to 90 percent.")
    ] = 1.0,
    ago: Annotated[float, typer.Option(metavar="S", min=0.0, help="It was so this many seconds ago.")] = 0.0,
    name: Annotated[str, typer.Option("--as", metavar="NAME", help="Who says it.")] = "operator",
    timeout: Annotated[
        float, typer.Option(metavar="S", min=0.1, help="Wait this long for the acknowledgement.")
    ] = 20.0,
    connect: Connect = None,
) -> None:
    """Tell a running team what you see, and wait until the fusion has it.

    The exit status is 0 if it was taken, 1 if it was refused or changes nothing, 2 if it makes no sense, and
    3 if nobody answers.

    \b
    Examples:
      searchparty observe operator near --at 120,80 --radius 15 --connect tcp/127.0.0.1:7447
      searchparty observe operator inside --at 0,0 --at 50,0 --at 50,50 --at 0,50 --not
      searchparty observe operator behind --at 20,40 --at 60,40 --target "cone 3" --slope 2
      searchparty observe operator in_front --at 10,10 --yaw 90 --reach 40
    """
    import asyncio

    from agents.mission.mission_file import load

    loaded = load(mission)
    table = _table(
        loaded,
        {
            "at_s": 0.0,
            "relation": relation,
            "at": [_place(text) for text in at or []],
            "yaw_deg": yaw,
            "radius_m": radius,
            "outer_m": outer,
            "reach_m": reach,
            "slope": slope,
            "positive": not nothing,
            "target": target,
        },
        name,
    )
    typer.echo(asyncio.run(_say(loaded, table, name, ago, timeout, tuple(connect or ()))))


def _place(text: str) -> list[float]:
    from agents.errors import MissionError

    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise MissionError(
            f"--at: found {text!r}, allowed are metres east and north, such as 12.5,-3"
        ) from None
    return [x, y]


def _table(mission: "Mission", raw: dict[str, Any], name: str) -> "StatementTable":
    """The checked statement.

    Raises:
        MissionError: with everything that is wrong with it.
    """
    from agents.errors import MalformedMessage, MissionError
    from agents.mission import tables
    from agents.mission.mission import StatementTable
    from agents.mission.mission_checks import deaf, is_reserved
    from agents.operator.statements import observation, said
    from agents.wire import codec
    from agents.wire.messages import SoftObservationMessage
    from agents.wire.topics import SOFT_OBSERVATION

    raw = {key: value for key, value in raw.items() if value is not None}
    problems = tables.not_finite(raw) or tables.check(raw, StatementTable)
    if problems:
        raise MissionError("\n".join(map(str, problems)))
    if is_reserved(name) or name in {robot.id for robot in mission.robots}:
        raise MissionError(f"--as: found {name!r}, which is a process of the team; take another")
    if deaf(mission.filter):
        raise MissionError(f"{mission.name}: the filter {mission.filter['kind']} takes no soft observations")
    table = tables.convert(raw, StatementTable)
    try:
        message = SoftObservationMessage(
            team=mission.team, sender=name, boot="b0", sequence=0, time=0.0, **said(table)
        )
        # What arrives is then surely a message that the fusion takes for one.
        codec.decode(SOFT_OBSERVATION, codec.encode(message), team=mission.team, sender=name)
        observation(message, mission.box().dimension)
    except MalformedMessage as error:
        raise MissionError(f"the statement cannot be sent: {error}") from None
    except ValueError as error:
        raise MissionError(str(error)) from None
    return table


async def _say(
    mission: "Mission",
    table: "StatementTable",
    name: str,
    ago: float,
    timeout: float,
    connect: tuple[str, ...],
) -> str:
    """What became of the statement, in words.

    Raises:
        SearchpartyError: if it was refused or changes nothing.
        LinkError: if nobody answers.
    """
    import asyncio
    import time

    from agents.errors import LinkError, SearchpartyError
    from agents.machine import Publish
    from agents.operator.operator_agent import Operator
    from agents.operator.statements import said
    from agents.process.shell import Shell
    from agents.wire.topics import EVENT, POSTERIOR, SOFT_OBSERVATION

    async with Shell(mission, "operator", name, connect) as shell:
        for topic in (POSTERIOR, EVENT):
            shell.transport.subscribe(topic)
        shell.transport.prepare(SOFT_OBSERVATION)
        try:
            await asyncio.wait_for(shell.join_team(), JOIN_S)
        except TimeoutError:
            raise LinkError("no fusion answers: start the team, or correct --connect") from None
        operator = Operator(mission, name, shell.boot, patience=shell.clock.speed)
        operator.plan(shell.clock.now() - ago * shell.clock.speed, said(table))
        deadline, settled = time.monotonic() + timeout, float("inf")
        while not shell.stopping:
            for action in operator.step(shell.clock.now(), shell.events()):
                if isinstance(action, Publish):
                    shell.publish(action.topic, action.message)
            wall = time.monotonic()
            answer = operator.answers.get(0)
            if answer is not None:
                if not answer.taken:
                    raise SearchpartyError(answer.text)
                return f"taken: {answer.text}"
            if not operator.waiting:
                settled = min(settled, wall + SETTLE_S)
            if wall >= settled:
                return "taken"
            if wall >= deadline:
                raise LinkError(
                    "the fusion did not acknowledge the statement: it may still arrive; look at "
                    "`searchparty watch`, or say it again with a longer --timeout"
                )
            soon = shell.clock.now() + 0.1 * shell.clock.speed
            await shell.sleep_until(min(soon, operator.next_wake()))
        raise LinkError("stopped before the fusion had acknowledged the statement")
