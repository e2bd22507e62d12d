"""Whose estimate people are shown: the fullest of the fusions, and of the robots while no fusion speaks."""

from agents.wire.messages import BeliefMessage, EstimateMessage, PosteriorMessage


class Shown:
    """Takes in every estimate that is published; `estimate` is the one to show."""

    def __init__(self, silence_s: float) -> None:
        """A robot's belief counts when no posterior came for this long, in seconds of the clock given."""
        self.estimate: EstimateMessage | None = None
        self._silence_s = silence_s
        self._heard_at = float("-inf")

    def __repr__(self) -> str:
        who = None if self.estimate is None else self.estimate.sender
        return f"Shown({who})"

    @property
    def alone(self) -> str:
        """The robot whose belief is shown for want of a fusion; else ""."""
        return self.estimate.sender if isinstance(self.estimate, BeliefMessage) else ""

    def hear(self, message: EstimateMessage, now: float) -> bool:
        """Whether the message is what is to be shown from now on."""
        shown = self.estimate
        if isinstance(message, PosteriorMessage):
            self._heard_at = now
            behind = isinstance(shown, PosteriorMessage) and message.applied < shown.applied
        else:
            behind = now - self._heard_at < self._silence_s or (
                shown is not None and message.applied < shown.applied
            )
        if not behind:
            self.estimate = message
        return not behind
