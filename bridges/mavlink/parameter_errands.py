"""Parameters beside flying: read some, or set one that a person has asked to be set."""

import math
from collections.abc import Mapping

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.parameters import Parameters

TRIES = 5
PATIENCE = 1.0  # s
REAL = mavlink.MAV_PARAM_TYPE_REAL32


class ReadParameters:
    """Asks for parameters by name; what the autopilot does not have is missing in `values`."""

    def __init__(self, names: tuple[str, ...], system: int, bytewise: bool) -> None:
        self._parameters = Parameters(system)
        self._parameters.read(names)
        self._bytewise = bytewise

    def __repr__(self) -> str:
        return f"ReadParameters({self._parameters!r})"

    @property
    def done(self) -> bool:
        return self._parameters.done

    @property
    def values(self) -> Mapping[str, float]:
        return self._parameters.values

    def step(self, now: float, received: list[Message]) -> list[Message]:
        """Ask, and ask again."""
        for message in received:
            if message.get_type() == "PARAM_VALUE":
                self._parameters.hear(message, self._bytewise)
        return self._parameters.step(now)


class SetParameter:
    """Sets one parameter that is no integer, and sees that the autopilot has taken it."""

    def __init__(self, name: str, value: float, system: int) -> None:
        self.done = False
        self.trouble = ""  # why it was not set, one sentence
        self._name = name
        self._value = value
        self._system = system
        self._tries = 0
        self._due = -math.inf

    def __repr__(self) -> str:
        return f"SetParameter({self._name} = {self._value:g}, done={self.done}, {self.trouble!r})"

    def step(self, now: float, received: list[Message]) -> list[Message]:
        """Set it, and set it again."""
        for message in received:
            if message.get_type() == "PARAM_VALUE" and message.param_id == self._name and self._tries:
                self.done = True
                if not math.isclose(message.param_value, self._value, rel_tol=1e-6):
                    self.trouble = (
                        f"{self._name} = {self._value:g} was refused: it is {message.param_value:g}"
                    )
        if self.done or now < self._due:
            return []
        if self._tries >= TRIES:
            self.done, self.trouble = True, f"{self._name} was not set: no answer after {TRIES} tries"
            return []
        self._tries += 1
        self._due = now + PATIENCE
        return [mavlink.MAVLink_param_set_message(self._system, 1, self._name.encode(), self._value, REAL)]
