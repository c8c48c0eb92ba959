"""The mission protocol, as far as both autopilots are alike: what is said, kept and flown. Pure.

https://mavlink.io/en/services/mission.html leaves open what a request gets beside the straight path
(another station, a wrong number, a time-out): `ardupilot_transfer.py` and `px4_transfer.py` answer
as their firmwares do. An upload replaces a list only when it is complete.
"""

from __future__ import annotations

from typing import Any

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.flying.mission_items import (
    MISSION,
    MissionItem,
    MissionResult,
    MissionTransfer,
    read_item,
    refusal,
)
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.protocol import uploaded_mission

MAX_ITEMS = 1000
_FRAME_OF_FLOATS = {5: 0, 6: 3, 11: 10}
"""MAV_FRAME of MISSION_ITEM_INT to that of MISSION_ITEM."""


def send_count(a: SimAutopilot, to: tuple[int, int], kind: int) -> None:
    """MISSION_COUNT; 0 of a kind that isn't known."""
    count = len(a.missions.lists.get(kind, ()))
    say(a, "MISSION_COUNT", to, count=count, mission_type=kind)


def send_item(a: SimAutopilot, message: Message) -> bool:
    """The item that a MISSION_REQUEST_INT or MISSION_REQUEST asks for; the latter's answer has
    degrees as floats. False where there is none."""
    kind, seq = message.fields["mission_type"], message.fields["seq"]
    items = a.missions.lists.get(kind, [])
    item = items[seq] if seq < len(items) else None
    if kind == MISSION and seq == 0:
        item = a.first_item(item)
    if item is None:
        return False
    as_int = message.name.endswith("_INT")
    fields = {
        "seq": seq,
        "mission_type": kind,
        "current": int(kind == MISSION and seq == a.missions.current),
        "command": item.command,
        "autocontinue": item.autocontinue,
        "frame": item.frame if as_int else _FRAME_OF_FLOATS.get(item.frame, item.frame),
        "x": item.x if as_int else item.x * 1e-7,
        "y": item.y if as_int else item.y * 1e-7,
        "z": item.z,
    } | {f"param{i + 1}": v for i, v in enumerate(item.p)}
    say(a, "MISSION_ITEM_INT" if as_int else "MISSION_ITEM", message.source, **fields)
    return True


def begin_upload(a: SimAutopilot, message: Message, first: int, end: int) -> None:
    """Items from `first` to before `end` are to come."""
    kind = message.fields["mission_type"]
    upload = MissionTransfer(kind, message.source, a.now, end, seq=first, first=first)
    a.missions.upload = a.missions.last = upload
    ask(a, upload)


def keep_item(a: SimAutopilot, upload: MissionTransfer, message: Message) -> None:
    """The item that the upload waits for: kept, and the next one asked for. One without sense ends
    the upload, the last one completes it."""
    found = read_item(message)
    wrong = MissionResult.INVALID
    if found is not None:
        wrong = refusal(upload.kind, found, a.known_item) or MissionResult.ACCEPTED
    if found is None or wrong is not MissionResult.ACCEPTED:
        a.missions.upload = None
        acknowledge(a, message.source, upload.kind, wrong)
        return
    upload.items.append(found)
    upload.seq += 1
    upload.heard_s = a.now
    if upload.seq < upload.end:
        ask(a, upload)
        return
    a.missions.upload = None
    before = a.missions.lists[upload.kind] if upload.first else []
    replace(a, upload.kind, [*before[: upload.first], *upload.items, *before[upload.end :]])
    acknowledge(a, upload.source, upload.kind, MissionResult.ACCEPTED)


def ask(a: SimAutopilot, upload: MissionTransfer) -> None:
    """For the next item."""
    upload.asked_s = a.now
    say(a, a.missions.request_name, upload.source, seq=upload.seq, mission_type=upload.kind)


def replace(a: SimAutopilot, kind: int, items: list[MissionItem]) -> None:
    """A whole list, by another."""
    a.missions.lists[kind] = items
    if kind == MISSION:
        a.missions.current = 0
        uploaded_mission.changed(a)


def acknowledge(a: SimAutopilot, to: tuple[int, int], kind: int, result: MissionResult) -> None:
    """MISSION_ACK."""
    say(a, "MISSION_ACK", to, type=int(result), mission_type=kind)


def say(a: SimAutopilot, name: str, to: tuple[int, int], **fields: Any) -> None:
    """A message of the protocol to the one that asked."""
    a.say(name, {"target_system": to[0], "target_component": to[1]} | fields, private=True)
