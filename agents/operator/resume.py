"""`searchparty resume`: give a vehicle back to its robot, after somebody took it over or it came down."""

# ruff: noqa: PLC0415 - the network is imported when the command runs, not when it is listed

from typing import TYPE_CHECKING, Annotated

import typer

from agents.cli import Connect, MissionArgument

if TYPE_CHECKING:
    from agents.mission.mission import Mission

JOIN_S = 10.0  # wall time within which the team must be heard
AGAIN_S = 0.5  # between two tries
LOOK_S = 0.05


def resume(
    mission: MissionArgument,
    robot: Annotated[str, typer.Argument(help="Whose vehicle is to be flown by its robot again.")],
    operator: Annotated[str, typer.Option("--as", metavar="NAME", help="Who says so.")] = "operator",
    timeout: Annotated[float, typer.Option(metavar="S", min=0.1, help="Wait this long for that.")] = 10.0,
    connect: Connect = None,
) -> None:
    """Let a robot fly its real vehicle again: after an operator's take-over, a fallback that lasts (low
    battery, out of bounds), or starts that failed. Without this it stays as it is.

    The exit status is 0 when the robot has said that it does, 2 if it makes no sense, 3 if nobody answers.

    \b
    Examples:
      searchparty resume mavlink_two_copters r1 --connect tcp/127.0.0.1:7447
    """
    import asyncio

    from agents.errors import MissionError
    from agents.mission.mission_file import load

    loaded = load(mission)
    names = [each.id for each in loaded.robots]
    if robot not in names:
        raise MissionError(f"the mission has no robot {robot!r}; its robots are {', '.join(names)}")
    if operator in names:
        raise MissionError(f"--as: found {operator!r}, which is a process of the team; take another")
    typer.echo(asyncio.run(_resume(loaded, robot, operator, timeout, tuple(connect or ()))))


async def _resume(
    mission: "Mission", robot: str, operator: str, timeout: float, connect: tuple[str, ...]
) -> str:
    """What the robot said.

    Raises:
        LinkError: if it says nothing.
    """
    import asyncio
    import time

    from agents.errors import LinkError
    from agents.machine import Heard
    from agents.process.shell import Shell
    from agents.wire.messages import EventMessage, ResumeMessage
    from agents.wire.topics import EVENT, RESUME

    async with Shell(mission, "operator", operator, connect) as shell:
        shell.transport.subscribe(EVENT)
        shell.transport.prepare(RESUME)
        try:
            await asyncio.wait_for(shell.join_team(), JOIN_S)
        except TimeoutError:
            raise LinkError("no fusion answers: start the team, or correct --connect") from None
        message = ResumeMessage(**shell.stamp.header(RESUME, shell.clock.now()), robot=robot)
        about = f"{operator}/{message.boot}/{message.sequence}"
        deadline, said = time.monotonic() + timeout, -AGAIN_S
        while time.monotonic() < deadline and not shell.stopping:
            if time.monotonic() - said >= AGAIN_S:
                said = time.monotonic()
                shell.publish(RESUME, message)
            for event in shell.events():
                if isinstance(event, Heard) and isinstance(event.message, EventMessage):
                    heard = event.message
                    if heard.sender == robot and heard.about == about:
                        return f"{robot}: {heard.text}"
            await asyncio.sleep(LOOK_S)
    raise LinkError(f"{robot} did not answer within {timeout:g} s: is it there, and has it a real vehicle?")
