"""Mission items, and the lists of them that a vehicle keeps. Pure.

Fence and rally lists are kept and given back; nothing flies by them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

from swarm_sim.firmware.message import (
    ABSOLUTE_FRAMES,
    NO_PLACE_FRAME,
    RELATIVE_FRAMES,
    MavCmd,
    Message,
)

MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
"""MAV_MISSION_TYPE."""
MAX_ITEMS = 1000
_FENCE_COMMANDS = range(5000, 5005)
_KNOWN: dict[int, frozenset[int]] = {
    MISSION: frozenset(
        {
            *range(MavCmd.NAV_WAYPOINT, MavCmd.NAV_TAKEOFF + 1),
            MavCmd.NAV_SPLINE_WAYPOINT,
            MavCmd.NAV_DELAY,
            *range(112, MavCmd.CONDITION_YAW + 1),
            *range(MavCmd.DO_SET_MODE, _FENCE_COMMANDS.start),
        }
    ),
    FENCE: frozenset(_FENCE_COMMANDS),
    RALLY: frozenset({5100}),
}
"""MAV_CMDs that a list may have. Commands that do or wait for something need no flying."""


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_SEQUENCE = 13


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
class MissionUpload:
    """A list that is being received."""

    kind: int
    count: int
    source: tuple[int, int]
    began_s: float
    asked_s: float
    items: list[MissionItem] = field(default_factory=list)


class MissionLists:
    """All lists of one vehicle."""

    def __init__(self) -> None:
        self.lists: dict[int, list[MissionItem]] = {MISSION: [], FENCE: [], RALLY: []}
        self.upload: MissionUpload | None = None
        self.current = 0
        """Index of the mission item that is, or would be, flown."""
        self.complete = False
        """The mission was flown to its end."""
        self.request_name = "MISSION_REQUEST"
        """Which of its two messages the vehicle uses to ask for items."""


def refusal(kind: int, item: MissionItem) -> MissionResult | None:
    """What is wrong with an item; None if nothing."""
    if item.frame not in (*ABSOLUTE_FRAMES, *RELATIVE_FRAMES, NO_PLACE_FRAME):
        return MissionResult.UNSUPPORTED_FRAME
    if item.frame != NO_PLACE_FRAME and not (math.isfinite(item.z) and abs(item.z) < 1e5):
        return MissionResult.INVALID
    return None if item.command in _KNOWN[kind] else MissionResult.UNSUPPORTED


def read_item(message: Message) -> MissionItem | None:
    """The item in a MISSION_ITEM_INT or MISSION_ITEM; None where its coordinates are none."""
    m = message.fields
    x, y = m["x"], m["y"]
    if message.name == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) <= 180.0 and abs(y) <= 180.0):
            return None
        x, y = round(x * 1e7), round(y * 1e7)
    p = (m["param1"], m["param2"], m["param3"], m["param4"])
    return MissionItem(m["command"], m["frame"], p, x, y, m["z"], m["autocontinue"])
