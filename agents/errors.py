"""Everything that can go wrong, as a small tree: who failed, and what to do about it.

Each message is one sentence a user can act on. The command line prints it and exits with `exit_code`.
"""


class SearchpartyError(Exception):
    """The base of all errors that are meant for the user's eyes."""

    exit_code = 1


class MissionError(SearchpartyError):
    """The mission file is wrong: which file, which key, what was found, what is allowed."""

    exit_code = 2


class LinkError(SearchpartyError):
    """The network cannot be had: a busy port, an unreachable router."""

    exit_code = 3


class JoinError(SearchpartyError):
    """This process may not be in the team: its id is taken, its clock or its certificate is wrong."""

    exit_code = 6


class DataError(SearchpartyError):
    """Input other than the mission is missing or unreadable: a recording, a map."""

    exit_code = 4


class StorageError(SearchpartyError):
    """The run directory cannot be written: full disk, no permission."""

    exit_code = 5


class MalformedMessage(SearchpartyError):
    """A message from the network that is not applied. `reason` is a short fixed word for counting."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
