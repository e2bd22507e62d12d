"""The role table: who may say what in a team, and who hears what.

Where the network is guarded (docs/security.md) the routers hold every process to this, under its own name.
"""

from dataclasses import dataclass

from agents.wire.topics import TOPICS


@dataclass(frozen=True, slots=True)
class Role:
    """One row, in names of topics."""

    says: tuple[str, ...]
    hears: tuple[str, ...]


EVERYTHING = tuple(TOPICS)

ROLES: dict[str, Role] = {
    "robot": Role(
        ("pose", "set", "plan", "bid", "belief", "clock", "health", "event"),
        (
            "pose",
            "set",
            "soft_observation",
            "plan",
            "bid",
            "request",
            "resume",
            "posterior",
            "picture",
            "state",
            "start",
        ),
    ),
    "fusion": Role(
        ("start", "posterior", "picture", "state", "ledger", "relay", "clock", "health", "event"),
        ("set", "soft_observation", "ledger", "relay", "clock", "start"),
    ),
    "operator": Role(
        ("soft_observation", "request", "resume", "clock"),
        ("start", "posterior", "event", "bid"),
    ),
    "watch": Role(("clock", "health", "event"), EVERYTHING),
    "status": Role(("clock",), tuple(name for name in TOPICS if name != "truth")),
    "swarm": Role(("truth", "clock", "event"), EVERYTHING),
}
EXCLUSIVE = ("robot", "fusion")  # roles of which no two processes may have the same id
