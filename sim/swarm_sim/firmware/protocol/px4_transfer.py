"""The mission protocol as PX4 1.15 serves it. Pure.

One transfer at a time, up or down, with one station; others hear that it is busy, or nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.flying.mission_items import ALL, MissionResult, MissionTransfer
from swarm_sim.firmware.message import MavSeverity, Message
from swarm_sim.firmware.protocol import uploaded_mission
from swarm_sim.firmware.protocol.mission_transfer import (
    MAX_ITEMS,
    acknowledge,
    ask,
    begin_upload,
    keep_item,
    replace,
    send_count,
    send_item,
)

_AGAIN_S, _GIVE_UP_S = 0.25, 5.0
"""An item that doesn't come is asked for again; a transfer of which nothing more is heard ends."""
_OTHER_REQUEST = {
    "MISSION_REQUEST": "MISSION_REQUEST_INT",
    "MISSION_REQUEST_INT": "MISSION_REQUEST",
}


def _idle(a: SimAutopilot) -> bool:
    return a.missions.upload is None and a.missions.download is None


def _is_partner(a: SimAutopilot, message: Message, words: str) -> bool:
    """Whether the last transfer was this station's; others are told."""
    last = a.missions.last
    if last is not None and last.source == message.source:
        return True
    a.text(MavSeverity.CRITICAL, f"{words}: partner id mismatch")
    return False


def _refuse(a: SimAutopilot, message: Message, words: str) -> None:
    a.text(MavSeverity.CRITICAL, words)
    acknowledge(a, message.source, message.fields["mission_type"], MissionResult.ERROR)


def request_list(a: SimAutopilot, message: Message) -> None:
    """A download that has come to its end may be followed by another, without an acknowledgement;
    one that has not, by the same again."""
    kind, m = message.fields["mission_type"], a.missions
    under_way = m.download
    same = under_way is not None and (under_way.kind, under_way.source) == (kind, message.source)
    over = under_way is not None and under_way.seq == under_way.end
    if m.upload is not None or not (under_way is None or same or over):
        a.text(MavSeverity.INFO, "Mission download request ignored, already active")
        return
    m.download = m.last = MissionTransfer(kind, message.source, a.now, len(m.lists.get(kind, ())))
    send_count(a, message.source, kind)


def request_item(a: SimAutopilot, message: Message) -> None:
    """The next item, or the last one again; any other number ends the download."""
    _learn(a, message)
    if not _is_partner(a, message, "WPM: REJ. CMD"):
        return
    download, seq = a.missions.download, message.fields["seq"]
    if a.missions.upload is not None:
        a.text(MavSeverity.CRITICAL, "WPM: REJ. CMD: Busy")
    elif download is not None and download.kind == message.fields["mission_type"]:
        download.heard_s = a.now
        expected = seq == download.seq < download.end or seq == download.seq - 1
        if expected and send_item(a, message):
            download.seq = seq + 1
        else:
            a.missions.download = None
            _refuse(a, message, "WPM: REJ. CMD: Req. WP was unexpected")


def _learn(a: SimAutopilot, message: Message) -> None:
    """Items are asked for as the client does: in integers (1e-7 degrees) or floats."""
    as_int = message.name.endswith("_INT")
    a.missions.request_name = "MISSION_REQUEST_INT" if as_int else "MISSION_REQUEST"


def count(a: SimAutopilot, message: Message) -> None:
    """An upload begins; before its first item has come, the count may come again."""
    kind, number, upload = (
        message.fields["mission_type"],
        message.fields["count"],
        a.missions.upload,
    )
    if a.missions.download is not None:
        _refuse(a, message, "WPM: IGN MISSION_COUNT: Busy")
    elif upload is not None and upload.source != message.source:
        acknowledge(a, message.source, kind, MissionResult.ERROR)
    elif upload is not None and upload.seq:
        upload.heard_s = a.now
        _refuse(a, message, "WPM: REJ. CMD: Busy")
    elif upload is not None:
        upload.heard_s = a.now
        ask(a, upload)
    elif number > MAX_ITEMS:
        acknowledge(a, message.source, kind, MissionResult.NO_SPACE)
    elif not number:
        if kind in a.missions.lists:
            replace(a, kind, [])
        acknowledge(a, message.source, kind, MissionResult.ACCEPTED)
    elif kind not in a.missions.lists:
        acknowledge(a, message.source, kind, MissionResult.INVALID)
    else:
        begin_upload(a, message, 0, number)


def item(a: SimAutopilot, message: Message) -> None:
    """MISSION_ITEM_INT, MISSION_ITEM: kept if it is the one asked for. The last one of the last
    upload is acknowledged again: the first acknowledgement was lost."""
    _learn(a, message)
    last, upload = a.missions.last, a.missions.upload
    if last is None or not _is_partner(a, message, "REJ. MIS ITEM"):
        a.ignored += 1
    elif message.fields["mission_type"] != last.kind:
        acknowledge(a, message.source, last.kind, MissionResult.ERROR)
    elif a.missions.download is not None:
        _refuse(a, message, "IGN MISSION_ITEM: Busy")
    elif upload is None:
        if message.fields["seq"] + 1 == last.seq:
            acknowledge(a, message.source, last.kind, MissionResult.ACCEPTED)
        else:
            _refuse(a, message, "IGN MISSION_ITEM: No transfer")
    elif message.fields["seq"] == upload.seq:
        keep_item(a, upload, message)
    else:
        upload.heard_s = a.now


def clear(a: SimAutopilot, message: Message) -> None:
    """MISSION_CLEAR_ALL; of a kind that isn't known, nothing."""
    kind = message.fields["mission_type"]
    if not _idle(a):
        a.text(MavSeverity.CRITICAL, "WPM: IGN CLEAR CMD: Busy")
        return
    for each in a.missions.lists:
        if kind in (each, ALL):
            replace(a, each, [])
    acknowledge(a, message.source, kind, MissionResult.ACCEPTED)


def answered(a: SimAutopilot, message: Message) -> None:
    """MISSION_ACK ends a download, and an upload that it cancels. A client that does not know the
    request says UNSUPPORTED, and is asked by the other one."""
    if not _is_partner(a, message, "REJ. WP CMD"):
        return
    m, result = a.missions, message.fields["type"]
    if m.download is not None and m.download.kind == message.fields["mission_type"]:
        m.download = None
    elif m.upload is not None and result == MissionResult.UNSUPPORTED:
        m.request_name = _OTHER_REQUEST[m.request_name]
        ask(a, m.upload)
    elif m.upload is not None and result == MissionResult.CANCELLED:
        m.upload = None


def set_current(a: SimAutopilot, message: Message) -> None:
    """MISSION_SET_CURRENT, answered by MISSION_CURRENT."""
    if not _idle(a):
        a.text(MavSeverity.CRITICAL, "WPM: IGN WP CURR CMD: Busy")
    elif uploaded_mission.go_on_at(a, message.fields["seq"]):
        uploaded_mission.say_current(a)
    else:
        a.text(MavSeverity.CRITICAL, "WPM: WP CURR CMD: Not in list")


def keep_going(a: SimAutopilot) -> None:
    """Asks again for an item that doesn't come; gives up in the end, up or down."""
    transfer = a.missions.upload or a.missions.download
    if transfer is None:
        return
    if a.now - transfer.heard_s > _GIVE_UP_S:
        a.missions.upload = a.missions.download = None
        a.text(MavSeverity.CRITICAL, "Operation timeout")
    elif transfer is a.missions.upload and a.now - transfer.asked_s >= _AGAIN_S:
        ask(a, transfer)


HANDLERS: Mapping[str, Callable[[SimAutopilot, Message], None]] = {
    "MISSION_REQUEST_LIST": request_list,
    "MISSION_REQUEST": request_item,
    "MISSION_REQUEST_INT": request_item,
    "MISSION_COUNT": count,
    "MISSION_ITEM": item,
    "MISSION_ITEM_INT": item,
    "MISSION_CLEAR_ALL": clear,
    "MISSION_SET_CURRENT": set_current,
    "MISSION_ACK": answered,
}
