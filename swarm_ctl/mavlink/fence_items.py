"""A vehicle's own fence: sent to it, taken off it, or read, by MAVLink's mission protocol (items
5001 to 5004). No sockets of its own, no clock.

The vehicle's autopilot acts on it by itself (ArduCopter: FENCE_ENABLE, FENCE_TYPE, FENCE_ACTION;
PX4: GF_ACTION): it is the last line, behind the agents' own zones.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.mavlink.framer import MavlinkFrame
from swarm_ctl.mavlink.outgoing import AUTOPILOT_COMPONENT, Message, interval
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mavlink.visitor import EACH_S, WAIT_S, Visitor
from swarm_ctl.mavlink.wires import Wire

FENCE: Final = dialect.MAV_MISSION_TYPE_FENCE
INSIDE, OUTSIDE = (
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
CIRCLE_INSIDE, CIRCLE_OUTSIDE = (
    dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    dialect.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
)
_MOST: Final = 1000


class FenceItem(NamedTuple):
    """One item: a corner, or a circle."""

    command: int
    size: float
    """Of a corner: how many its polygon has; of a circle: its radius [m]."""
    lat_e7: int
    lon_e7: int


@dataclass(frozen=True, slots=True)
class FenceReport:
    """What the vehicle has, or why that is not known."""

    trouble: str = ""
    items: tuple[FenceItem, ...] = ()

    @property
    def words(self) -> str:
        """`a fence of 4 corners, 2 polygons and 1 circle to keep out of`."""
        inside = sum(item.command in (INSIDE, CIRCLE_INSIDE) for item in self.items)
        polygons = sum(1 / item.size for item in self.items if item.command == OUTSIDE)
        circles = sum(item.command == CIRCLE_OUTSIDE for item in self.items)
        if not self.items:
            return "no fence"
        fence = f"a fence of {inside} corners" if inside else "no fence to stay inside of"
        return f"{fence}, {polygons:.0f} polygons and {circles} circles to keep out of"


def items_of(plan: Plan) -> tuple[list[FenceItem], list[str]]:
    """The items of a plan's fence and zones; and the zones that are left out, since an item has no
    heights: a vehicle may fly over or under them."""
    found, left = list[FenceItem](), list[str]()

    def put(command: int, size: float, corners_m: Sequence[Point]) -> None:
        for north, east in corners_m:
            at = geodetic_from_ned((north, east, 0.0), plan.origin)
            found.append(FenceItem(command, size, round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)))

    if plan.fence is not None and plan.fence.polygon_m:
        put(INSIDE, len(plan.fence.polygon_m), plan.fence.polygon_m)
    for zone in plan.zones:
        if zone.floor_m is not None or zone.ceiling_m is not None:
            left.append(zone.name)
        elif len(zone.corners_m) == 1:
            put(CIRCLE_OUTSIDE, zone.radius_m, zone.corners_m)
        else:
            put(OUTSIDE, len(zone.corners_m), zone.corners_m)
    return found, left


class FenceTransfer:
    """One vehicle on one link. `step` is to be called again and again until it gives the report.

    `items`: what the vehicle is to have; (): none; None: it is only read.
    """

    def __init__(
        self,
        wire: Wire,
        sysid: int,
        items: Sequence[FenceItem] | None,
        signing: LinkSigning | None = None,
    ) -> None:
        self._sysid, self._items, self._signing = sysid, items, signing
        self._visitor = Visitor(wire, sysid, signing)
        self._heard = self._armed = False
        self._count: int | None = None
        self._found: dict[int, FenceItem] = {}
        self._ack: int | None = None
        self._given = False
        """The vehicle asks for items by itself."""
        self._now = 0.0
        self._plan = self._work()

    def step(self, now: float) -> FenceReport | None:
        """Take in what has come, and send what is due."""
        self._now = now
        for frame in self._visitor.heard(now):
            self._take(frame)
        try:
            next(self._plan)
        except StopIteration as end:
            trouble: str = end.value
            return FenceReport(trouble, tuple(self._found[k] for k in sorted(self._found)))
        return None

    def _work(self) -> Generator[None, None, str]:
        """One thing after another; its value is the trouble."""
        yield from self._until(lambda: self._heard, self._greet)
        about = f"vehicle {self._sysid}"
        if not self._heard:
            return f"{about} was not heard in {WAIT_S:.0f} s"
        if self._items is not None:
            if self._armed:
                return f"{about} is armed; allowed: a disarmed one"
            yield from self._until(lambda: self._ack is not None, self._offer)
            if self._ack != dialect.MAV_MISSION_ACCEPTED:
                return f"{about} {self._answer()}"
        yield from self._until(lambda: self._count is not None, self._ask_count)
        if self._count is None:
            return f"{about} does not tell its fence"
        yield from self._until(lambda: len(self._found) >= (self._count or 0), self._ask_next)
        if len(self._found) < self._count:
            return f"{about} has told {len(self._found)} of {self._count} items of its fence"
        self._say(self._to(dialect.MAVLink_mission_ack_message, dialect.MAV_MISSION_ACCEPTED))
        if self._items is not None and not self._same():
            return f"{about} has another fence than it was sent"
        return ""

    def _answer(self) -> str:
        if self._ack is None:
            return "takes no fence: no answer"
        names = dialect.enums["MAV_MISSION_RESULT"]
        name = names[self._ack].name if self._ack in names else str(self._ack)
        return f"refuses the fence: {name.removeprefix('MAV_MISSION_').lower()}"

    def _same(self) -> bool:
        told = [self._found[k] for k in sorted(self._found)]
        return len(told) == len(self._items or ()) and all(
            (a.command, a.lat_e7, a.lon_e7) == (b.command, b.lat_e7, b.lon_e7)
            and abs(a.size - b.size) < 0.01
            for a, b in zip(told, self._items or (), strict=True)
        )

    def _until(
        self, condition: Callable[[], bool], act: Callable[[], None]
    ) -> Generator[None, None, None]:
        """Say it again each second; what comes meanwhile gives it more time."""
        end, due, seen = self._now + WAIT_S, self._now, len(self._found)
        while not condition() and self._now < end:
            more = len(self._found) > seen
            if self._now >= due or more:
                end = self._now + WAIT_S if more else end
                due, seen = self._now + EACH_S, len(self._found)
                act()
            yield

    # --- what is said ---

    def _to(self, kind: Any, *rest: Any) -> Message:
        return kind(self._sysid, AUTOPILOT_COMPONENT, *rest, FENCE)

    def _greet(self) -> None:
        """A vehicle on UDP speaks to those that it has heard."""
        self._say(interval(self._sysid, dialect.MAVLINK_MSG_ID_HEARTBEAT, 1.0))

    def _offer(self) -> None:
        if not self._items:
            self._say(self._to(dialect.MAVLink_mission_clear_all_message))
        elif not self._given:
            self._say(self._to(dialect.MAVLink_mission_count_message, len(self._items)))

    def _ask_count(self) -> None:
        self._say(self._to(dialect.MAVLink_mission_request_list_message))

    def _ask_next(self) -> None:
        seq = next(k for k in range(_MOST) if k not in self._found)
        self._say(self._to(dialect.MAVLink_mission_request_int_message, seq))

    def _give(self, seq: int) -> None:
        if self._items is None or not 0 <= seq < len(self._items):
            return
        item, frame = self._items[seq], dialect.MAV_FRAME_GLOBAL
        about = (seq, frame, item.command, 0, 1, item.size, 0.0, 0.0, 0.0)
        place = (item.lat_e7, item.lon_e7, 0.0)
        self._say(self._to(dialect.MAVLink_mission_item_int_message, *about, *place))
        self._given = True

    def _say(self, message: Message) -> None:
        self._visitor.say(message, self._now)

    # --- what is heard ---

    def _take(self, frame: MavlinkFrame) -> None:
        if self._signing is not None and self._signing.refusal(frame) is not None:
            return
        message = self._visitor.read(frame)
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._heard = True
            self._armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        elif getattr(message, "mission_type", None) != FENCE:
            return
        elif kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            self._give(message.seq)
        elif kind == "MISSION_ACK" and self._ack is None:
            self._ack = message.type
        elif kind == "MISSION_COUNT" and message.count <= _MOST:
            self._count = message.count
        elif kind == "MISSION_ITEM_INT" and message.seq < _MOST:
            item = FenceItem(message.command, message.param1, message.x, message.y)
            self._found[message.seq] = item
