"""In whose hands a robot's vehicle is: a real one takes off first, and an operator may take it over."""

from agents.devices import VehicleState


class Hands:
    """Remembers what the vehicle last said of itself."""

    def __init__(self) -> None:
        self.able = True  # it goes where the robot tells it
        self.doing = ""  # else, in a word or two

    def __repr__(self) -> str:
        return f"Hands({'ours' if self.able else self.doing})"

    def turned(self, body: VehicleState) -> bool:
        """Take in what it says; whether it has come into other hands, or back."""
        before, self.able, self.doing = self.able, body.able, body.doing
        return before != body.able
