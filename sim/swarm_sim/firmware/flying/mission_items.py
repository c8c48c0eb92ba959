"""Mission items, and the lists of them that a vehicle keeps. Pure.

Rally lists are kept and given back; nothing flies by them. Fences: `autopilot.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum

from swarm_sim.firmware.message import ABSOLUTE_FRAMES, NO_PLACE_FRAME, RELATIVE_FRAMES, Message

MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
"""MAV_MISSION_TYPE."""
MAX_ITEMS = 1000
_FENCES, _RALLY_POINTS = frozenset(range(5000, 5005)), frozenset({5100})


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_SEQUENCE = 13
    DENIED = 14
    CANCELLED = 15


@dataclass(frozen=True, slots=True)
class MissionItem:
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
        on_earth = abs(self.x) <= 900_000_000 and abs(self.y) <= 1_800_000_000
        return (self.x, self.y) != (0, 0) and on_earth


@dataclass(slots=True)
class MissionTransfer:
    """A list that is being received, or (PX4) sent."""

    kind: int
    source: tuple[int, int]
    """The other side."""
    heard_s: float
    """When it was last heard."""
    end: int
    """Index after the last item."""
    seq: int = 0
    """Index of the next item."""
    asked_s: float = 0.0
    first: int = 0
    items: list[MissionItem] = field(default_factory=list)
    """Received, from `first` on."""


class MissionLists:
    """All lists of one vehicle."""

    def __init__(self) -> None:
        self.lists: dict[int, list[MissionItem]] = {MISSION: [], FENCE: [], RALLY: []}
        self.upload: MissionTransfer | None = None
        self.download: MissionTransfer | None = None
        self.last: MissionTransfer | None = None
        """The last transfer, under way or over."""
        self.current = 0
        """Index of the mission item that is, or would be, flown."""
        self.complete = False
        """The mission was flown to its end."""
        self.request_name = "MISSION_REQUEST"
        """Which of its two messages the vehicle uses to ask for items."""


def refusal(
    kind: int, item: MissionItem, known: Callable[[int, int], bool]
) -> MissionResult | None:
    """What is wrong with an item; None if nothing. `known`: whether a mission may have this command
    in this frame."""
    if item.frame not in (*ABSOLUTE_FRAMES, *RELATIVE_FRAMES, NO_PLACE_FRAME):
        return MissionResult.UNSUPPORTED_FRAME
    if item.frame != NO_PLACE_FRAME and not (math.isfinite(item.z) and abs(item.z) < 1e5):
        return MissionResult.INVALID
    if kind == MISSION:
        return None if known(item.command, item.frame) else MissionResult.UNSUPPORTED
    return None if item.command in (_FENCES, _RALLY_POINTS)[kind - 1] else MissionResult.UNSUPPORTED


def read_item(message: Message) -> MissionItem | None:
    """The item in a MISSION_ITEM_INT or MISSION_ITEM; None where its coordinates are none."""
    m = message.fields
    x, y = m["x"], m["y"]
    if message.name == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) <= 180.0 and abs(y) <= 180.0):
            return None
        x, y = round(x * 1e7), round(y * 1e7)
    p = (m["param1"], m["param2"], m["param3"], m["param4"])
    return MissionItem(
        command=m["command"],
        frame=m["frame"],
        p=p,
        x=x,
        y=y,
        z=m["z"],
        autocontinue=m["autocontinue"],
    )
