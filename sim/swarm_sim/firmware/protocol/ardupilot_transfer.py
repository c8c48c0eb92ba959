"""The mission protocol as ArduCopter 4.7 serves it. Pure.

Each request for items is answered by itself; an upload is bound to one station. Others are denied
meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.flying.mission_items import (
    MISSION,
    MissionResult,
    MissionTransfer,
    read_item,
    refusal,
)
from swarm_sim.firmware.message import Message
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

_AGAIN_S, _GIVE_UP_S = 1.0, 8.0
"""An item that doesn't come is asked for again; then the upload ends."""
_FLY_THERE = 2
"""MISSION_ITEM.current of an item that is no part of any list, but flown at once."""


def _of_list(
    serve: Callable[[SimAutopilot, Message, MissionTransfer | None], None],
) -> Callable[[SimAutopilot, Message], None]:
    """Serves a request about a known list, with its upload if there is one; others are
    UNSUPPORTED."""

    def served(a: SimAutopilot, message: Message) -> None:
        kind, upload = message.fields["mission_type"], a.missions.upload
        if kind not in a.missions.lists:
            acknowledge(a, message.source, kind, MissionResult.UNSUPPORTED)
        else:
            serve(a, message, upload if upload is not None and upload.kind == kind else None)

    return served


def _foreign(message: Message, upload: MissionTransfer | None) -> bool:
    return upload is not None and upload.source != message.source


def _refuse(a: SimAutopilot, message: Message, result: MissionResult) -> None:
    acknowledge(a, message.source, message.fields["mission_type"], result)


def request_list(a: SimAutopilot, message: Message, upload: MissionTransfer | None) -> None:
    if upload is not None:
        _refuse(a, message, MissionResult.DENIED)
    else:
        send_count(a, message.source, message.fields["mission_type"])


def request_item(a: SimAutopilot, message: Message, upload: MissionTransfer | None) -> None:
    """A wrong number is told the right count, too."""
    if upload is not None:
        _refuse(a, message, MissionResult.DENIED)
    elif not send_item(a, message):
        send_count(a, message.source, message.fields["mission_type"])
        _refuse(a, message, MissionResult.INVALID_SEQUENCE)


def count(a: SimAutopilot, message: Message, upload: MissionTransfer | None) -> None:
    """An upload begins, or begins again."""
    number = message.fields["count"]
    if _foreign(message, upload):
        _refuse(a, message, MissionResult.DENIED)
    elif number > MAX_ITEMS:
        _refuse(a, message, MissionResult.NO_SPACE)
    elif not number:
        replace(a, message.fields["mission_type"], [])
        _refuse(a, message, MissionResult.ACCEPTED)
    else:
        begin_upload(a, message, 0, number)


def write_partial_list(a: SimAutopilot, message: Message, upload: MissionTransfer | None) -> None:
    """Some items of the list are to be replaced."""
    first, last = message.fields["start_index"], message.fields["end_index"]
    there = len(a.missions.lists[message.fields["mission_type"]])
    if _foreign(message, upload):
        _refuse(a, message, MissionResult.DENIED)
    elif not 0 <= first <= last < there:
        _refuse(a, message, MissionResult.ERROR)
    else:
        begin_upload(a, message, first, last + 1)


def item(a: SimAutopilot, message: Message, upload: MissionTransfer | None) -> None:
    """MISSION_ITEM_INT, MISSION_ITEM: kept if it is the one asked for."""
    if upload is None:
        _refuse(a, message, MissionResult.ERROR)
    elif _foreign(message, upload):
        _refuse(a, message, MissionResult.DENIED)
    elif message.fields["seq"] != upload.seq:
        _refuse(a, message, MissionResult.INVALID_SEQUENCE)
    else:
        keep_item(a, upload, message)


def _item(a: SimAutopilot, message: Message) -> None:
    if message.fields["current"] == _FLY_THERE:
        _fly_there(a, message)
    else:
        _of_list(item)(a, message)


def _fly_there(a: SimAutopilot, message: Message) -> None:
    """dronekit's `simple_goto` and MAVProxy's `guided`."""
    found = read_item(message)
    good = found is not None and refusal(MISSION, found, a.known_item) is None
    if found is None or not good:
        a.ignored += 1
        return
    result = MissionResult.ACCEPTED if a.guided_item(found) else MissionResult.ERROR
    acknowledge(a, message.source, MISSION, result)


def clear(a: SimAutopilot, message: Message, upload: MissionTransfer | None) -> None:
    """MISSION_CLEAR_ALL ends the station's own upload; a foreign one is denied, then failed."""
    if _foreign(message, upload):
        _refuse(a, message, MissionResult.DENIED)
        _refuse(a, message, MissionResult.ERROR)
        return
    if upload is not None:
        a.missions.upload = None
    replace(a, message.fields["mission_type"], [])
    _refuse(a, message, MissionResult.ACCEPTED)


def set_current(a: SimAutopilot, message: Message) -> None:
    """MISSION_SET_CURRENT, answered by MISSION_CURRENT."""
    if uploaded_mission.go_on_at(a, message.fields["seq"]):
        uploaded_mission.say_current(a)
    else:
        a.ignored += 1


def keep_going(a: SimAutopilot) -> None:
    """Asks again for an item that doesn't come; gives up in the end."""
    upload = a.missions.upload
    if upload is None:
        return
    if a.now - upload.heard_s > _GIVE_UP_S:
        a.missions.upload = None
        acknowledge(a, upload.source, upload.kind, MissionResult.CANCELLED)
    elif a.now - upload.asked_s >= _AGAIN_S:
        ask(a, upload)


HANDLERS: Mapping[str, Callable[[SimAutopilot, Message], None]] = {
    "MISSION_REQUEST_LIST": _of_list(request_list),
    "MISSION_REQUEST": _of_list(request_item),
    "MISSION_REQUEST_INT": _of_list(request_item),
    "MISSION_COUNT": _of_list(count),
    "MISSION_WRITE_PARTIAL_LIST": _of_list(write_partial_list),
    "MISSION_ITEM": _item,
    "MISSION_ITEM_INT": _item,
    "MISSION_CLEAR_ALL": _of_list(clear),
    "MISSION_SET_CURRENT": set_current,
}
