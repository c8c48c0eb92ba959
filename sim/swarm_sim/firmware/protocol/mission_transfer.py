"""The mission protocol: lists of items (mission, fence, rally) up and down, cleared, and the
current one set. Pure.

https://mavlink.io/en/services/mission.html. An upload replaces a list only when it is complete.
"""

from __future__ import annotations

from typing import Any

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.flying.mission_items import (
    ALL,
    MAX_ITEMS,
    MISSION,
    MissionItem,
    MissionResult,
    MissionUpload,
    read_item,
    refusal,
)
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.protocol import uploaded_mission

_AGAIN_S, _GIVE_UP_S = 1.0, 8.0
"""An item that doesn't come is asked for again, then the upload is forgotten."""
_FLY_THERE = 2
"""MISSION_ITEM.current of an item that is no part of any list, but flown at once."""
_FRAME_OF_FLOATS = {5: 0, 6: 3, 11: 10}
"""MAV_FRAME of MISSION_ITEM_INT to that of MISSION_ITEM."""
_OTHER_REQUEST = {
    "MISSION_REQUEST": "MISSION_REQUEST_INT",
    "MISSION_REQUEST_INT": "MISSION_REQUEST",
}


def request_list(a: SimAutopilot, message: Message) -> None:
    """MISSION_REQUEST_LIST."""
    kind = message.fields["mission_type"]
    if kind not in a.missions.lists:
        _acknowledge(a, message.source, kind, MissionResult.UNSUPPORTED)
        return
    count = len(a.missions.lists[kind])
    _say(a, "MISSION_COUNT", message.source, count=count, mission_type=kind)


def request_item(a: SimAutopilot, message: Message) -> None:
    """MISSION_REQUEST_INT, and MISSION_REQUEST, whose answer has degrees as floats."""
    kind, seq = message.fields["mission_type"], message.fields["seq"]
    items = a.missions.lists.get(kind, [])
    item = items[seq] if seq < len(items) else None
    if kind == MISSION and seq == 0:
        item = a.first_item(item)
    if item is None:
        _acknowledge(a, message.source, kind, MissionResult.INVALID_SEQUENCE)
        return
    as_int = _learn(a, message)
    current = int(kind == MISSION and seq == a.missions.current)
    fields = {
        "seq": seq,
        "mission_type": kind,
        "current": current,
        "command": item.command,
        "autocontinue": item.autocontinue,
        "frame": item.frame if as_int else _FRAME_OF_FLOATS.get(item.frame, item.frame),
        "x": item.x if as_int else item.x * 1e-7,
        "y": item.y if as_int else item.y * 1e-7,
        "z": item.z,
    } | {f"param{i + 1}": v for i, v in enumerate(item.p)}
    _say(a, "MISSION_ITEM_INT" if as_int else "MISSION_ITEM", message.source, **fields)


def _learn(a: SimAutopilot, message: Message) -> bool:
    """Whether the client speaks in integers (1e-7 degrees)."""
    as_int = message.name.endswith("_INT")
    if a.asks_in_kind:
        a.missions.request_name = "MISSION_REQUEST_INT" if as_int else "MISSION_REQUEST"
    return as_int


def count(a: SimAutopilot, message: Message) -> None:
    """MISSION_COUNT: an upload begins; a second one takes the place of the first."""
    kind, number = message.fields["mission_type"], message.fields["count"]
    if kind not in a.missions.lists:
        _acknowledge(a, message.source, kind, MissionResult.UNSUPPORTED)
    elif number > MAX_ITEMS:
        _acknowledge(a, message.source, kind, MissionResult.NO_SPACE)
    else:
        a.missions.upload = MissionUpload(kind, number, message.source, a.now, a.now)
        _go_on(a, a.missions.upload)


def item(a: SimAutopilot, message: Message) -> None:
    """MISSION_ITEM_INT, MISSION_ITEM: kept if it is the one asked for; that is asked for again."""
    upload, m = a.missions.upload, message.fields
    if m["current"] == _FLY_THERE:
        _fly_there(a, message)
        return
    if upload is None or (message.source, m["mission_type"]) != (upload.source, upload.kind):
        a.ignored += 1
        return
    _learn(a, message)
    if m["seq"] == len(upload.items):
        found = read_item(message)
        wrong = MissionResult.INVALID if found is None else refusal(upload.kind, found)
        if found is None or wrong is not None:
            a.missions.upload = None
            _acknowledge(a, message.source, upload.kind, wrong or MissionResult.INVALID)
            return
        upload.items.append(found)
    _go_on(a, upload)


def _fly_there(a: SimAutopilot, message: Message) -> None:
    """dronekit's `simple_goto` and MAVProxy's `guided`."""
    found = read_item(message)
    flown = None if found is None or refusal(MISSION, found) is not None else a.guided_item(found)
    if flown is None:
        a.ignored += 1
    else:
        result = MissionResult.ACCEPTED if flown else MissionResult.ERROR
        _acknowledge(a, message.source, MISSION, result)


def clear(a: SimAutopilot, message: Message) -> None:
    """MISSION_CLEAR_ALL."""
    kind = message.fields["mission_type"]
    kinds = tuple(a.missions.lists) if kind == ALL else (kind,)
    if kinds[0] not in a.missions.lists:
        _acknowledge(a, message.source, kind, MissionResult.UNSUPPORTED)
        return
    for each in kinds:
        _replace(a, each, [])
    _acknowledge(a, message.source, kind, MissionResult.ACCEPTED)


def answered(a: SimAutopilot, message: Message) -> None:
    """MISSION_ACK: a client that does not know the request says UNSUPPORTED; PX4 then uses the
    other one."""
    upload = a.missions.upload
    unknown = message.fields["type"] == MissionResult.UNSUPPORTED
    if upload is None or message.source != upload.source or not (unknown and a.asks_in_kind):
        return
    a.missions.request_name = _OTHER_REQUEST[a.missions.request_name]
    _go_on(a, upload)


def set_current(a: SimAutopilot, message: Message) -> None:
    """MISSION_SET_CURRENT, answered by MISSION_CURRENT."""
    if uploaded_mission.go_on_at(a, message.fields["seq"]):
        uploaded_mission.say_current(a)
    else:
        a.ignored += 1


def remind(a: SimAutopilot) -> None:
    """Asks again for an item that doesn't come; gives up in the end."""
    upload = a.missions.upload
    if upload is None or a.now - upload.asked_s < _AGAIN_S:
        return
    if a.now - upload.began_s > _GIVE_UP_S + _AGAIN_S * len(upload.items):
        a.missions.upload = None
    else:
        _go_on(a, upload)


def _acknowledge(a: SimAutopilot, to: tuple[int, int], kind: int, result: MissionResult) -> None:
    _say(a, "MISSION_ACK", to, type=int(result), mission_type=kind)


def _go_on(a: SimAutopilot, upload: MissionUpload) -> None:
    upload.asked_s = a.now
    at, kind = len(upload.items), upload.kind
    if at < upload.count:
        _say(a, a.missions.request_name, upload.source, seq=at, mission_type=kind)
        return
    a.missions.upload = None
    _replace(a, kind, upload.items)
    _acknowledge(a, upload.source, kind, MissionResult.ACCEPTED)


def _replace(a: SimAutopilot, kind: int, items: list[MissionItem]) -> None:
    a.missions.lists[kind] = items
    if kind == MISSION:
        a.missions.current = 0
        uploaded_mission.changed(a)


def _say(a: SimAutopilot, name: str, to: tuple[int, int], **fields: Any) -> None:
    a.say(name, {"target_system": to[0], "target_component": to[1]} | fields, private=True)
