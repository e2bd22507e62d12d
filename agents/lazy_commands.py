"""Commands of the command line that are imported when they are used, not when they are listed.

`searchparty --help` must not import a viewer or a simulator. Commands come from the entry points
searchparty.commands: a function as typer takes it, or a `typer.Typer`.
"""

from importlib.metadata import EntryPoint, entry_points
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

GROUP = "searchparty.commands"

# What --help says of our own; another package's command is listed with the package's name.
SHORT_HELP = {
    "calibrate": "Estimate sensors from a recording with known truth.",
    "keys": "Make the certificates of a guarded team.",
    "ledger": "Show or export what a run's fusions stored.",
    "campaign": "Let everything go wrong, and check what must hold.",
    "observe": "Tell a running team what you see.",
    "request": "Ask a running team to look at a place.",
    "router": "Run the router that a team in the field meets at.",
    "simulate": "Run a mission in virtual time for many seeds.",
    "status": "Say how the processes of a running team are.",
    "vehicle": "Look at a MAVLink vehicle, check it, fly a test square.",
    "watch": "Show a running team, and record the picture.",
}


class LazyCommand(TyperCommand):
    """Stands for a command in lists, and hands over to it as soon as it is used."""

    def __init__(self, point: EntryPoint) -> None:
        package = point.dist.name if point.dist is not None else "an installed package"
        text = SHORT_HELP.get(point.name, f"A command of {package}.")
        super().__init__(point.name, help=text, short_help=text, rich_markup_mode=None)
        self._point = point

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """The context of the real command: click goes on with `context.command`."""
        return self.load().make_context(info_name, args, parent, **extra)

    def load(self) -> Any:
        """The real command."""
        target = self._point.load()
        if not isinstance(target, typer.Typer):
            app = typer.Typer(add_completion=False, rich_markup_mode=None)
            app.command(self._point.name)(target)
            target = app
        command = typer.main.get_command(target)
        command.name = self._point.name
        return command


class LazyGroup(TyperGroup):
    """A group whose further commands come from entry points."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
            if point.name not in self.commands:
                self.commands[point.name] = LazyCommand(point)
