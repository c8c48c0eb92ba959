"""The mission protocol: lists of items (mission, fence, rally) up and down, cleared, and the
current one set. Pure.

https://mavlink.io/en/services/mission.html. Each list of a vehicle is one `Plan`; uploads replace
it only when complete. Fence and rally lists are kept and given back; nothing flies by them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from sim.firmware.message import Message

if TYPE_CHECKING:
    from sim.firmware.base import Firmware

MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
"""MAV_MISSION_TYPE."""
MAX_ITEMS = 1000
_AGAIN_S, _GIVE_UP_S = 1.0, 8.0
"""An item that doesn't come is asked for again, then the upload is forgotten."""


class Answer(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_SEQUENCE = 13


class Nav(IntEnum):
    """MAV_CMD of mission items that are flown."""

    WAYPOINT = 16
    LOITER_UNLIM = 17
    LOITER_TURNS = 18
    LOITER_TIME = 19
    RETURN = 20
    LAND = 21
    TAKEOFF = 22
    SPLINE = 82
    DELAY = 93
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178


_FIRST_DO, _FIRST_CONDITION, _LAST_CONDITION = 176, 112, 115
_FENCE_COMMANDS, _RALLY_COMMAND = range(5000, 5005), 5100
ABSOLUTE_FRAMES, RELATIVE_FRAMES, NO_PLACE_FRAME = (0, 5), (3, 6, 10, 11), 2


@dataclass(frozen=True, slots=True)
class Item:
    """A mission item; x and y in 1e-7 degrees."""

    command: int
    frame: int
    p: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1

    @property
    def placed(self) -> bool:
        """It names a point (0, 0 means here)."""
        return (
            (self.x, self.y) != (0, 0)
            and abs(self.x) <= 900_000_000
            and abs(self.y) <= 1_800_000_000
        )


@dataclass(slots=True)
class Upload:
    """A list that is being received."""

    kind: int
    count: int
    source: tuple[int, int]
    began_s: float
    asked_s: float
    items: list[Item] = field(default_factory=list)


class Plans:
    """All lists of one vehicle."""

    def __init__(self) -> None:
        self.lists: dict[int, list[Item]] = {MISSION: [], FENCE: [], RALLY: []}
        self.upload: Upload | None = None
        self.current = 0
        """Index of the mission item that is, or would be, flown."""
        self.item_request = "MISSION_REQUEST"
        """With which of its two messages the vehicle asks for items."""


def refusal(kind: int, item: Item) -> Answer | None:
    """What is wrong with an item; None if nothing."""
    if item.frame not in (*ABSOLUTE_FRAMES, *RELATIVE_FRAMES, NO_PLACE_FRAME):
        return Answer.UNSUPPORTED_FRAME
    if item.frame != NO_PLACE_FRAME and not (math.isfinite(item.z) and abs(item.z) < 1e5):
        return Answer.INVALID
    if kind == FENCE:
        known = item.command in _FENCE_COMMANDS
    elif kind == RALLY:
        known = item.command == _RALLY_COMMAND
    else:
        condition = _FIRST_CONDITION <= item.command <= _LAST_CONDITION
        known = (
            item.command in set(Nav)
            or condition
            or _FIRST_DO <= item.command < _FENCE_COMMANDS.start
        )
    return None if known else Answer.UNSUPPORTED


def request_list(f: Firmware, message: Message) -> None:
    """MISSION_REQUEST_LIST."""
    kind = message.fields["mission_type"]
    if kind not in f.plans.lists:
        acknowledge(f, message.source, kind, Answer.UNSUPPORTED)
        return
    _say(f, "MISSION_COUNT", message.source, count=len(f.plans.lists[kind]), mission_type=kind)


def request_item(f: Firmware, message: Message) -> None:
    """MISSION_REQUEST_INT, and MISSION_REQUEST, whose answer has degrees as floats."""
    kind, seq = message.fields["mission_type"], message.fields["seq"]
    items = f.plans.lists.get(kind, [])
    item = items[seq] if seq < len(items) else None
    if kind == MISSION and seq == 0:
        item = f.first_item(item)
    if item is None:
        acknowledge(f, message.source, kind, Answer.INVALID_SEQUENCE)
        return
    as_int = _learn(f, message)
    here = {"x": item.x, "y": item.y} if as_int else {"x": item.x * 1e-7, "y": item.y * 1e-7}
    frame = item.frame if as_int else {5: 0, 6: 3, 11: 10}.get(item.frame, item.frame)
    numbers = {f"param{i + 1}": v for i, v in enumerate(item.p)}
    rest = {"command": item.command, "current": int(kind == MISSION and seq == f.plans.current)}
    more = {
        "seq": seq,
        "frame": frame,
        "autocontinue": item.autocontinue,
        "z": item.z,
        "mission_type": kind,
    }
    _say(
        f,
        "MISSION_ITEM_INT" if as_int else "MISSION_ITEM",
        message.source,
        **numbers,
        **here,
        **rest,
        **more,
    )


def _learn(f: Firmware, message: Message) -> bool:
    """Whether the client speaks in integers (1e-7 degrees)."""
    as_int = message.name.endswith("_INT")
    if f.asks_in_kind:
        f.plans.item_request = "MISSION_REQUEST_INT" if as_int else "MISSION_REQUEST"
    return as_int


def count(f: Firmware, message: Message) -> None:
    """MISSION_COUNT: an upload begins; a second one takes the place of the first."""
    kind, number = message.fields["mission_type"], message.fields["count"]
    if kind not in f.plans.lists:
        acknowledge(f, message.source, kind, Answer.UNSUPPORTED)
    elif number > MAX_ITEMS:
        acknowledge(f, message.source, kind, Answer.NO_SPACE)
    else:
        f.plans.upload = Upload(kind, number, message.source, f.now, f.now)
        _go_on(f, f.plans.upload)


def item(f: Firmware, message: Message) -> None:
    """MISSION_ITEM_INT, MISSION_ITEM: the one asked for is kept; for any other the right one is
    asked for again."""
    upload, m = f.plans.upload, message.fields
    if m["current"] == _GO_THERE:
        _go_there(f, message)
        return
    if upload is None or (message.source, m["mission_type"]) != (upload.source, upload.kind):
        f.ignored += 1
        return
    _learn(f, message)
    if m["seq"] == len(upload.items):
        found = read_item(message)
        wrong = Answer.INVALID if found is None else refusal(upload.kind, found)
        if found is None or wrong is not None:
            f.plans.upload = None
            acknowledge(f, message.source, upload.kind, wrong or Answer.INVALID)
            return
        upload.items.append(found)
    _go_on(f, upload)


def _go_there(f: Firmware, message: Message) -> None:
    """dronekit's `simple_goto` and MAVProxy's `guided`: an item that is no part of any list."""
    found = read_item(message)
    flown = None if found is None or refusal(MISSION, found) is not None else f.guided_item(found)
    if flown is None:
        f.ignored += 1
    else:
        acknowledge(f, message.source, MISSION, Answer.ACCEPTED if flown else Answer.ERROR)


_GO_THERE = 2
"""MISSION_ITEM.current of such an item."""


def read_item(message: Message) -> Item | None:
    """The item in a message; None where its place is none."""
    m = message.fields
    x, y = m["x"], m["y"]
    if message.name == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) <= 180.0 and abs(y) <= 180.0):
            return None
        x, y = round(x * 1e7), round(y * 1e7)
    p = (m["param1"], m["param2"], m["param3"], m["param4"])
    return Item(m["command"], m["frame"], p, x, y, m["z"], m["autocontinue"])


def clear(f: Firmware, message: Message) -> None:
    """MISSION_CLEAR_ALL."""
    kind = message.fields["mission_type"]
    kinds = tuple(f.plans.lists) if kind == ALL else (kind,)
    if kinds[0] not in f.plans.lists:
        acknowledge(f, message.source, kind, Answer.UNSUPPORTED)
        return
    for each in kinds:
        _replace(f, each, [])
    acknowledge(f, message.source, kind, Answer.ACCEPTED)


def answered(f: Firmware, message: Message) -> None:
    """MISSION_ACK: a client that does not know the request says UNSUPPORTED; PX4 then asks by the
    other one."""
    upload = f.plans.upload
    if (
        upload is None
        or message.source != upload.source
        or message.fields["type"] != Answer.UNSUPPORTED
    ):
        return
    if f.asks_in_kind:
        others = {
            "MISSION_REQUEST": "MISSION_REQUEST_INT",
            "MISSION_REQUEST_INT": "MISSION_REQUEST",
        }
        f.plans.item_request = others[f.plans.item_request]
        _go_on(f, upload)


def set_current(f: Firmware, message: Message) -> None:
    """MISSION_SET_CURRENT, answered by MISSION_CURRENT."""
    if f.go_on_at(message.fields["seq"]):
        f.say_current()
    else:
        f.ignored += 1


def remind(f: Firmware) -> None:
    """Asks again for an item that doesn't come; gives up in the end."""
    upload = f.plans.upload
    if upload is None or f.now - upload.asked_s < _AGAIN_S:
        return
    if f.now - upload.began_s > _GIVE_UP_S + _AGAIN_S * len(upload.items):
        f.plans.upload = None
    else:
        _go_on(f, upload)


def acknowledge(f: Firmware, to: tuple[int, int], kind: int, answer: Answer) -> None:
    """MISSION_ACK."""
    _say(f, "MISSION_ACK", to, type=int(answer), mission_type=kind)


def _go_on(f: Firmware, upload: Upload) -> None:
    upload.asked_s = f.now
    if len(upload.items) < upload.count:
        _say(
            f, f.plans.item_request, upload.source, seq=len(upload.items), mission_type=upload.kind
        )
        return
    f.plans.upload = None
    _replace(f, upload.kind, upload.items)
    acknowledge(f, upload.source, upload.kind, Answer.ACCEPTED)


def _replace(f: Firmware, kind: int, items: list[Item]) -> None:
    f.plans.lists[kind] = items
    if kind == MISSION:
        f.plans.current = 0
        f.mission_changed()


def _say(f: Firmware, name: str, to: tuple[int, int], **fields: Any) -> None:
    f.say(name, {"target_system": to[0], "target_component": to[1]} | fields, private=True)
