"""What the bridge tells people."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Event:
    """Something that a person may want to read."""

    time: float
    level: str  # "info", "warning", "error"
    text: str
