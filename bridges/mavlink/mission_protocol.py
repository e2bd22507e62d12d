"""The mission protocol from our side: plans to a vehicle and back, as errands beside flying.

An errand is pure: time and messages in, messages out. A bridge runs it:

    upload = Upload(items, PlanKind.MISSION, (system, 1), (system, 191), home_first=True)
    bridge.run(upload)
    while not upload.done: ...
    if upload.trouble: ...            # one sentence; the plan that was on board before is still there

`Download` and `Clear` likewise; `Download.items` are what is on board. `home_first` says that the vehicle's
item 0 of a mission is its home (ArduPilot, `keeps_home_first`): one is put before and taken off again here,
so that callers never see it.

Only MISSION_ITEM_INT is sent, whichever way the vehicle asks. What is not answered is sent again, up to 5
times, after 1.5 s, or 0.25 s and longer each time for single items.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence

from bridges.mavlink.dialect import Message, mavlink
from bridges.mavlink.mission_items import ABSOLUTE, RESULTS, WAYPOINT, Item, PlanKind

TRIES = 6  # the first and five more
PATIENCE = 1.5  # s
ITEM_PATIENCE = 0.25  # s, doubled with each try up to PATIENCE
MOST = 5000  # items that anybody may say to have
ACCEPTED = mavlink.MAV_MISSION_ACCEPTED
Address = tuple[int, int]  # system, component


def keeps_home_first(autopilot: str) -> bool:
    """Whether item 0 of this autopilot's missions is its home, by the name in `PilotReport.autopilot`."""
    return autopilot == "ArduPilot"


class Conversation(ABC):
    """What uploads and downloads share: one question at a time, asked until answered."""

    def __init__(self, kind: PlanKind, vehicle: Address, us: Address) -> None:
        self.kind = kind
        self.done = False
        self.trouble = ""  # why it failed, one sentence
        self.resent = 0
        self._vehicle = vehicle
        self._us = us
        self._question: list[Message] = []
        self._tries = 0
        self._due = -1.0
        self._patience = PATIENCE

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.kind.word}, done={self.done}, {self.trouble!r})"

    def step(self, now: float, received: list[Message]) -> list[Message]:
        """What to send now; `received` is what the vehicle said since the last step."""
        out: list[Message] = []
        if self.done:
            return out
        if not self._question:
            self._begin(now)
        for message in received:
            if self._concerns(message) and not self.done:
                out += self._hear(now, message)
        if not self.done and now >= self._due:
            if self._tries >= TRIES:
                self._fail(f"no answer after {self._tries} tries")
            else:
                out += self._question
                self.resent += self._tries > 0
                self._tries += 1
                self._due = now + min(PATIENCE, self._patience)
                self._patience *= 2
        return out

    @abstractmethod
    def _begin(self, now: float) -> None:
        """Ask the first question."""

    @abstractmethod
    def _hear(self, now: float, message: Message) -> list[Message]:
        """Take in an answer; what to send at once."""

    def _concerns(self, message: Message) -> bool:
        if (
            not message.get_type().startswith("MISSION_")
            or getattr(message, "mission_type", None) != self.kind
        ):
            return False
        if (message.get_srcSystem(), message.get_srcComponent()) != self._vehicle:
            return False
        system, component = message.target_system, message.target_component
        return system in (0, self._us[0]) and component in (0, self._us[1])

    def _ask(self, question: list[Message], now: float, patience: float = PATIENCE) -> None:
        """Ask this from now on, at once."""
        self._question, self._tries, self._due, self._patience = question, 0, now, patience

    def _answered(self, question: list[Message], now: float) -> None:
        """An answer went out; ask this if nothing follows."""
        self._question, self._patience, self._due = question, PATIENCE, now + PATIENCE
        self._tries = 1

    def _end(self) -> None:
        self.done = True

    def _fail(self, why: str) -> None:
        self.trouble = f"{self._what}: {why}"
        self.done = True

    @property
    @abstractmethod
    def _what(self) -> str:
        """What is being done, for people."""

    def _refused(self, result: int) -> str:
        return RESULTS.get(result, f"refused with result {result}")


class Upload(Conversation):
    """Puts a plan on board in place of the one of its kind there; no items: takes that away."""

    def __init__(
        self, items: Sequence[Item], kind: PlanKind, vehicle: Address, us: Address, home_first: bool = False
    ) -> None:
        super().__init__(kind, vehicle, us)
        self._empty = not items
        first = [Item(WAYPOINT, frame=ABSOLUTE)] if home_first and kind == PlanKind.MISSION else []
        self._items = [*first, *items]
        self._sent: set[int] = set()

    @property
    def progress(self) -> float:
        """The share of items that the vehicle has asked for, 0-1."""
        return len(self._sent) / len(self._items) if self._items else float(self.done)

    @property
    def _what(self) -> str:
        return f"upload of the {self.kind.word}"

    def _begin(self, now: float) -> None:
        self._ask(self._offer(), now)

    def _offer(self) -> list[Message]:
        if self._empty:
            return [mavlink.MAVLink_mission_clear_all_message(*self._vehicle, int(self.kind))]
        return [mavlink.MAVLink_mission_count_message(*self._vehicle, len(self._items), int(self.kind))]

    def _hear(self, now: float, message: Message) -> list[Message]:
        kind = message.get_type()
        if kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST") and not self._empty:
            number = message.seq
            if not 0 <= number < len(self._items):
                self._fail(f"the vehicle asked for item {number} of {len(self._items)}")
                return []
            self._sent.add(number)
            item = self._items[number].message(self._vehicle, number, self.kind)
            # Where the last acknowledgement is lost, the whole is offered again: a vehicle that has it all
            # takes no single item any more.
            self._answered(self._offer() if len(self._sent) == len(self._items) else [item], now)
            return [item]
        if kind == "MISSION_ACK":
            if message.type != ACCEPTED:
                self._fail(self._refused(message.type))
            elif self._empty or len(self._sent) == len(self._items):
                self._end()  # else it is a late one, of an upload before this
        return []


class Download(Conversation):
    """Reads what is on board."""

    def __init__(self, kind: PlanKind, vehicle: Address, us: Address, home_first: bool = False) -> None:
        super().__init__(kind, vehicle, us)
        self.items: list[Item] = []  # whole when done without trouble
        self._home_first = home_first and kind == PlanKind.MISSION
        self._count: int | None = None

    @property
    def _what(self) -> str:
        return f"download of the {self.kind.word}"

    def _begin(self, now: float) -> None:
        self._ask([mavlink.MAVLink_mission_request_list_message(*self._vehicle, int(self.kind))], now)

    def _hear(self, now: float, message: Message) -> list[Message]:
        kind = message.get_type()
        if kind == "MISSION_ACK" and message.type != ACCEPTED:
            self._fail(self._refused(message.type))
        elif kind == "MISSION_COUNT" and self._count is None:
            if message.count > MOST:
                self._fail(f"the vehicle says that it has {message.count} items")
                return []
            self._count = message.count
            return self._next(now)
        elif kind == "MISSION_ITEM_INT" and self._count is not None and message.seq == len(self.items):
            self.items.append(Item.of(message))
            return self._next(now)
        return []

    def _next(self, now: float) -> list[Message]:
        number = len(self.items)
        assert self._count is not None
        if number < self._count:
            ask = mavlink.MAVLink_mission_request_int_message(*self._vehicle, number, int(self.kind))
            self._ask([ask], now, ITEM_PATIENCE)
            return []
        if self._home_first:
            self.items = self.items[1:]
        self._end()
        return [mavlink.MAVLink_mission_ack_message(*self._vehicle, ACCEPTED, int(self.kind))]


class Clear(Upload):
    """Takes a plan off board."""

    def __init__(self, kind: PlanKind, vehicle: Address, us: Address) -> None:
        super().__init__((), kind, vehicle, us)

    @property
    def _what(self) -> str:
        return f"removal of the {self.kind.word}"
