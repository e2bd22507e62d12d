"""`searchparty request`: an operator asks a running team to look at a place, and hears who goes there."""

# ruff: noqa: PLC0415 - the network and numpy are imported when the command runs, not when it is listed

from typing import TYPE_CHECKING, Annotated, Any

import typer

from agents.cli import Connect, MissionArgument

if TYPE_CHECKING:
    from agents.mission.mission import Mission, RequestTable

JOIN_S = 10.0  # wall time within which the team must be heard


def request(
    mission: MissionArgument,
    name: Annotated[str, typer.Argument(help="What to call it; the same name again replaces it.")],
    at: Annotated[
        str, typer.Option(metavar="X,Y[,Z]", help="Where to look, m; as many as the area has axes.")
    ] = "",
    worth: Annotated[
        float, typer.Option(metavar="W", help="How much it matters, in targets to be found.")
    ] = 1.0,
    robots: Annotated[int, typer.Option(metavar="N", help="How many robots must look.")] = 1,
    needs: Annotated[
        list[str] | None, typer.Option(metavar="CAPABILITY", help="What they must be able to do. Repeatable.")
    ] = None,
    withdraw: Annotated[bool, typer.Option("--withdraw", help="Ask no more for what has this name.")] = False,
    done: Annotated[bool, typer.Option("--done", help="Wait until they have looked.")] = False,
    operator: Annotated[str, typer.Option("--as", metavar="NAME", help="Who asks.")] = "operator",
    timeout: Annotated[float, typer.Option(metavar="S", min=0.1, help="Wait this long for that.")] = 20.0,
    connect: Connect = None,
) -> None:
    """Ask a running team to look at a place, and wait until its robots have settled who goes there.

    Only for missions whose robots share tasks (planner cbba). The exit status is 0 if somebody goes, 1 if
    nobody can or will, 2 if it makes no sense, and 3 if nobody answers.

    \b
    Examples:
      searchparty request tasks door --at 120,80 --worth 3 --connect tcp/127.0.0.1:7447
      searchparty request tasks wreck --at 300,40 --robots 2 --needs close_up --done
      searchparty request tasks door --withdraw
    """
    import asyncio

    from agents.mission.mission_file import load

    loaded = load(mission)
    place = [] if withdraw and not at else _place(at)
    table = _table(
        loaded,
        {
            "at_s": 0.0,
            "name": name,
            "at": place or [float(x) for x in loaded.area.min],
            "worth": 0.0 if withdraw else worth,
            "robots": robots,
            "needs": needs or [],
        },
        operator,
    )
    typer.echo(asyncio.run(_ask(loaded, table, operator, done, timeout, tuple(connect or ()))))


def _place(text: str) -> list[float]:
    from agents.errors import MissionError

    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise MissionError(
            f"--at: found {text!r}, allowed are metres east and north (and up), such as 12.5,-3"
        ) from None


def _table(mission: "Mission", raw: dict[str, Any], operator: str) -> "RequestTable":
    """The checked request.

    Raises:
        MissionError: with everything that is wrong with it.
    """
    from agents.errors import MissionError
    from agents.mission import tables
    from agents.mission.mission import RequestTable
    from agents.mission.mission_checks import is_reserved, request_problems

    problems = tables.not_finite(raw) or tables.check(raw, RequestTable)
    if problems:
        raise MissionError("\n".join(map(str, problems)))
    if is_reserved(operator) or operator in {robot.id for robot in mission.robots}:
        raise MissionError(f"--as: found {operator!r}, which is a process of the team; take another")
    table = tables.convert(raw, RequestTable)
    problems = request_problems(mission, table, "")
    if problems:
        raise MissionError("\n".join(map(str, problems)))
    return table


async def _ask(
    mission: "Mission",
    table: "RequestTable",
    operator: str,
    until_done: bool,
    timeout: float,
    connect: tuple[str, ...],
) -> str:
    """What became of the request, in words.

    Raises:
        SearchpartyError: if nobody goes.
        LinkError: if nobody answers.
    """
    import asyncio
    import time

    from agents.allocation.requests import PREFIX
    from agents.errors import LinkError, SearchpartyError
    from agents.machine import Publish
    from agents.operator.requester import Requester
    from agents.process.shell import Shell
    from agents.wire.topics import BID, REQUEST

    name = PREFIX + table.name
    async with Shell(mission, "operator", operator, connect) as shell:
        shell.transport.subscribe(BID)
        shell.transport.prepare(REQUEST)
        try:
            await asyncio.wait_for(shell.join_team(), JOIN_S)
        except TimeoutError:
            raise LinkError("no fusion answers: start the team, or correct --connect") from None
        requester = Requester(mission, operator, shell.boot, patience=shell.clock.speed)
        requester.plan(shell.clock.now(), table)
        deadline = time.monotonic() + timeout
        while not shell.stopping:
            for action in requester.step(shell.clock.now(), shell.events()):
                if isinstance(action, Publish):
                    shell.publish(action.topic, action.message)
            known, holders, looked = (d.get(name, set()) for d in _views(requester))
            if table.worth == 0.0 and known:
                return f"{table.name} is withdrawn"
            if len(looked) >= table.robots:
                return f"done: {_and(looked)} looked at {table.name}"
            if len(holders | looked) >= table.robots and not until_done:
                return f"taken: {_and(holders | looked)} will look at {table.name}"
            if time.monotonic() >= deadline:
                if not known:
                    raise LinkError(
                        "no robot passed the request on: look at `searchparty watch`, or ask again with a "
                        "longer --timeout"
                    )
                if holders:
                    raise SearchpartyError(
                        f"{_and(holders)} will look at {table.name}, but it is not done yet; the team goes on"
                    )
                raise SearchpartyError(
                    f"{_and(known)} heard of {table.name}, but nobody took it: they have enough to do that "
                    "is worth more (try a higher --worth), or too few can do it"
                )
            soon = shell.clock.now() + 0.1 * shell.clock.speed
            await shell.sleep_until(min(soon, requester.next_wake()))
        raise LinkError("stopped before anybody had answered")


def _views(requester: Any) -> tuple[dict[str, set[str]], ...]:
    return requester.known, requester.holders, requester.looked


def _and(names: set[str]) -> str:
    return " and ".join(sorted(names))
