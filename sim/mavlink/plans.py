"""The mission protocol from the vehicle's side: missions, fences and rally points, up and down.

An upload is staged: until its last item is in and sound the old plan stands, and it stands if the upload
fails. Lost requests are repeated, and given up after some seconds.
"""

import math
from dataclasses import dataclass, field

from bridges.mavlink.dialect import Message, mavlink

MISSION, FENCE, RALLY = 0, 1, 2
RETRY, RETRIES = 0.25, 20
MOST = 700
GLOBAL_FRAMES = {0, 3, 5, 6, 10, 11}
LAST_PLACED = 90  # greater commands have no position
FENCE_COMMANDS = {5000, 5001, 5002, 5003, 5004}
OK, ERROR, BAD_FRAME, UNSUPPORTED, NO_SPACE, INVALID = 0, 1, 2, 3, 4, 5
BAD_SEQUENCE, DENIED = 13, 14


@dataclass(frozen=True, slots=True)
class Item:
    """One item as it came. Latitude and longitude are in degrees, or metres in a local frame."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    autocontinue: int = 1


@dataclass(slots=True)
class _Upload:
    kind: int
    count: int
    peer: tuple[int, int]
    items: list[Item] = field(default_factory=list)
    asked: float = 0.0
    tries: int = 0


class Plans:
    """What is on board, and one upload at a time."""

    def __init__(self, commands: set[int], home_first: bool) -> None:
        self._commands = commands
        self._home_first = home_first  # ArduPilot: item 0 of a mission is home, whatever was sent
        self.items: dict[int, list[Item]] = {MISSION: [], FENCE: [], RALLY: []}
        self.changed: set[int] = set()
        self.home: Item | None = None
        self._upload: _Upload | None = None

    def __repr__(self) -> str:
        return f"Plans({ {kind: len(items) for kind, items in self.items.items()} })"

    def receive(self, message: Message, now: float) -> list[Message]:
        """The answers to a MISSION_* message of the protocol."""
        kind = message.get_type()
        peer = (message.get_srcSystem(), message.get_srcComponent())
        if kind == "MISSION_COUNT":
            return self._begin(message, peer, now)
        if kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            return self._item(message, peer, now)
        if kind == "MISSION_REQUEST_LIST":
            count = len(self._listed(message.mission_type))
            return [mavlink.MAVLink_mission_count_message(*peer, count, message.mission_type)]
        if kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            return self._download(message, peer)
        if kind == "MISSION_CLEAR_ALL":
            return self._clear(message, peer)
        return []

    def tick(self, now: float) -> list[Message]:
        """A request again that was not answered; the end of an upload that stays silent."""
        upload = self._upload
        if upload is None or now - upload.asked < RETRY:
            return []
        upload.tries += 1
        if upload.tries > RETRIES:
            self._upload = None
            return [_ack(upload.peer, 15, upload.kind)]  # OPERATION_CANCELLED
        return self._request(upload, now)

    def _begin(self, message: Message, peer: tuple[int, int], now: float) -> list[Message]:
        kind = message.mission_type
        if kind not in self.items:
            return [_ack(peer, UNSUPPORTED, kind)]
        if self._upload is not None and self._upload.peer != peer:
            return [_ack(peer, DENIED if self._home_first else ERROR, kind)]
        if message.count > MOST:
            return [_ack(peer, NO_SPACE, kind)]
        if message.count == 0:
            self._replace(kind, [])
            return [_ack(peer, OK, kind)]
        self._upload = _Upload(kind, message.count, peer)
        return self._request(self._upload, now)

    def _request(self, upload: _Upload, now: float) -> list[Message]:
        upload.asked = now
        ask = (
            mavlink.MAVLink_mission_request_message
            if self._home_first  # ArduPilot still asks this way, and takes either item
            else mavlink.MAVLink_mission_request_int_message
        )
        return [ask(*upload.peer, len(upload.items), upload.kind)]

    def _item(self, message: Message, peer: tuple[int, int], now: float) -> list[Message]:
        upload = self._upload
        if upload is None or upload.peer != peer or message.mission_type != upload.kind:
            return [] if upload is None else [_ack(peer, DENIED, message.mission_type)]
        if message.seq != len(upload.items):
            return []  # a repeated or early one: the request is repeated in its time
        item, trouble = self._read(message, upload.kind)
        if trouble != OK:
            self._upload = None
            return [_ack(peer, trouble, upload.kind)]
        upload.items.append(item)
        upload.tries = 0
        if len(upload.items) < upload.count:
            return self._request(upload, now)
        self._upload = None
        if upload.kind == FENCE and not sound_fence(upload.items):
            return [_ack(peer, INVALID if self._home_first else ERROR, FENCE)]
        self._replace(upload.kind, upload.items)
        return [_ack(peer, OK, upload.kind)]

    def _read(self, message: Message, kind: int) -> tuple[Item, int]:
        scale = 1.0
        if message.get_type() == "MISSION_ITEM_INT":
            scale = 1e-7 if message.frame in GLOBAL_FRAMES or message.frame == 2 else 1e-4
        item = Item(
            message.frame,
            message.command,
            (message.param1, message.param2, message.param3, message.param4),
            message.x * scale,
            message.y * scale,
            message.z,
            message.autocontinue,
        )
        if item.frame not in GLOBAL_FRAMES | {2}:
            return item, BAD_FRAME
        wanted = {FENCE: FENCE_COMMANDS, RALLY: {5100}}.get(kind, self._commands)
        if item.command not in wanted:
            return item, UNSUPPORTED
        placed = kind != MISSION or item.command < LAST_PLACED  # what is done anywhere has no place
        if placed and not (math.isfinite(item.z) and abs(item.x) <= 90 and abs(item.y) <= 180):
            return item, INVALID
        return item, OK

    def _replace(self, kind: int, items: list[Item]) -> None:
        self.items[kind] = items[1:] if kind == MISSION and self._home_first else items
        self.changed.add(kind)

    def _listed(self, kind: int) -> list[Item]:
        items = self.items.get(kind, [])
        if kind == MISSION and self._home_first and self.home is not None:
            return [self.home, *items]
        return items

    def _download(self, message: Message, peer: tuple[int, int]) -> list[Message]:
        items = self._listed(message.mission_type)
        if not 0 <= message.seq < len(items):
            return [_ack(peer, BAD_SEQUENCE, message.mission_type)]
        item = items[message.seq]
        whole = message.get_type() == "MISSION_REQUEST_INT"
        made = mavlink.MAVLink_mission_item_int_message if whole else mavlink.MAVLink_mission_item_message
        scale = (1e7 if item.frame in GLOBAL_FRAMES or item.frame == 2 else 1e4) if whole else 1.0
        x, y = (round(item.x * scale), round(item.y * scale)) if whole else (item.x, item.y)
        head = (*peer, message.seq, item.frame, item.command, 0, item.autocontinue, *item.params)
        return [made(*head, x, y, item.z, message.mission_type)]

    def _clear(self, message: Message, peer: tuple[int, int]) -> list[Message]:
        kinds = list(self.items) if message.mission_type == 255 else [message.mission_type]
        if kinds[0] not in self.items:
            return [_ack(peer, UNSUPPORTED, message.mission_type)]
        for kind in kinds:
            self.items[kind] = []
            self.changed.add(kind)
        return [_ack(peer, OK, message.mission_type)]


def sound_fence(items: list[Item]) -> bool:
    """Whether every polygon has as many vertices as its items say, and no circle is empty."""
    index = 0
    while index < len(items):
        item = items[index]
        if item.command in (5001, 5002):
            count = int(item.params[0])
            ring = items[index : index + count]
            same = all(one.command == item.command and one.params[0] == count for one in ring)
            if count < 3 or len(ring) < count or not same:
                return False
            index += count
        else:
            if item.command in (5003, 5004) and item.params[0] <= 0:
                return False
            index += 1
    return True


def _ack(peer: tuple[int, int], result: int, kind: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(*peer, result, kind)
