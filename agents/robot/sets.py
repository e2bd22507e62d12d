"""A robot's own sets, kept until a fusion has them, and what it reckons by itself while there is none."""

from agents.machine import Action, Publish, Release, Stamp, Store
from agents.robot.alone import Alone
from agents.robot.belief import Belief
from agents.robot.plan_request import RobotSetup
from agents.robot.unacknowledged import Unacknowledged
from agents.wire.messages import LedgerEntry, MeasurementSetMessage, Message, PosteriorMessage, StateMessage
from agents.wire.topics import SET


class OwnSets:
    """Hears what concerns the ledger; stores, sends and offers again what the robot measured."""

    def __init__(self, setup: RobotSetup, now: float) -> None:
        reoffer_after = setup.mission.settings.reoffer_after_s * max(1.0, setup.patience)
        self.unacknowledged: Unacknowledged[MeasurementSetMessage] = Unacknowledged(
            setup.boot, reoffer_after, setup.left
        )
        self.alone = None if setup.alone is None else Alone(setup.alone, setup.robot, now, setup.patience)
        self._robot = setup.robot
        self._released: list[tuple[str, int]] = []  # acknowledged in this step

    def __repr__(self) -> str:
        return f"OwnSets({self.unacknowledged}, alone={self.alone is not None and self.alone.alone})"

    def next_wake(self) -> float:
        """When `step` or `due` must be called even if nothing happens."""
        offer = self.unacknowledged.next_offer()
        return offer if self.alone is None else min(offer, self.alone.next_wake())

    def hear(self, now: float, message: Message) -> None:
        """A posterior, a fusion's state, or somebody's entry for the ledger."""
        if isinstance(message, PosteriorMessage):
            self._released += self.unacknowledged.acknowledge(self._robot, message)
        if self.alone is None:
            return
        if isinstance(message, PosteriorMessage):
            self.alone.hear_posterior(now, message)
        elif isinstance(message, StateMessage):
            self.alone.hear_state(message)
        elif isinstance(message, LedgerEntry):
            self.alone.hear(message)

    def take(self, message: MeasurementSetMessage) -> list[Action]:
        """A set of this robot's own."""
        self.unacknowledged.add(message)
        if self.alone is not None:
            self.alone.hear(message)
        return [Store([message]), Publish(SET, message)]

    def reckoned(self, number: int) -> None:
        """What `step` asked to be reckoned is done."""
        if self.alone is not None:
            self.alone.reckoned(number)

    def step(self, now: float, stamp: Stamp, belief: Belief) -> list[Action]:
        """Go on without a fusion, where none is heard."""
        return [] if self.alone is None else list(self.alone.step(now, stamp, belief))

    def due(self, now: float) -> list[Action]:
        """Offer again what nobody acknowledged, and let go of what somebody did."""
        actions: list[Action] = [Publish(SET, message) for message in self.unacknowledged.due(now)]
        if self._released:
            actions.append(Release(self._released))
            self._released = []
        return actions
