"""A battery that flying empties."""

from dataclasses import dataclass

FLYING, RESTING = 15.0, 0.5  # A


@dataclass(slots=True)
class Battery:
    """`left` is the share 0..1 that is left."""

    flight_time: float  # s from full to empty in the air
    full: float  # V
    empty: float  # V
    left: float = 1.0
    amperes: float = RESTING

    def volts(self) -> float:
        return self.empty + (self.full - self.empty) * self.left

    def spend(self, seconds: float, flying: bool) -> None:
        self.amperes = FLYING if flying else RESTING
        self.left = max(self.left - seconds * self.amperes / (FLYING * self.flight_time), 0.0)
