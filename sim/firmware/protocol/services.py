"""The messages every MAVLink vehicle serves, as a table from name to function. Pure.

A message that isn't in the table, not for this system, or makes no sense is counted by
`Firmware.handle` or here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from sim.firmware.flying import guided
from sim.firmware.flying.setpoint import read_setpoint
from sim.firmware.message import Message, Result
from sim.firmware.protocol import mission_lists
from sim.firmware.protocol.commands import MAX_RATE_HZ, read_command

if TYPE_CHECKING:
    from sim.firmware.base import Firmware

SET_MODE_ID = 11
"""The legacy SET_MODE message is acknowledged as a command with its own message id."""
_BY_NAME = -1
"""PARAM_REQUEST_READ.param_index when the name counts."""


def heartbeat(f: Firmware, message: Message) -> None:
    """HEARTBEAT of a ground station keeps the vehicle from its failsafe."""
    if f.is_gcs(message.source[0], message.fields["type"]):
        f.gcs_heartbeat()


def command(f: Firmware, message: Message) -> None:
    """COMMAND_LONG, COMMAND_INT."""
    asked = read_command(message)
    if not f.addressed(asked):
        f.ignored += 1
        return
    handler = f.commands.get(asked.id)
    result = Result.UNSUPPORTED if handler is None else handler(f, asked)
    if result is not None:
        f.acknowledge(asked.id, result, asked.source)


def set_mode(f: Firmware, message: Message) -> None:
    """SET_MODE."""
    result = f.set_mode(message.fields["base_mode"], message.fields["custom_mode"])
    f.acknowledge(SET_MODE_ID, result, message.source)


def set_position_target(f: Firmware, message: Message) -> None:
    """SET_POSITION_TARGET_LOCAL_NED."""
    setpoint = read_setpoint(message.fields, f.sensed.heading_rad, f.local_position())
    if setpoint is None:
        f.ignored += 1
    else:
        f.on_setpoint(setpoint)


def param_list(f: Firmware, _: Message) -> None:
    """PARAM_REQUEST_LIST: the values follow a few at a time."""
    f.pending_parameters.clear()
    f.pending_parameters.extend(f.parameters.names)


def param_read(f: Firmware, message: Message) -> None:
    """PARAM_REQUEST_READ."""
    index = message.fields["param_index"]
    name = message.fields["param_id"] if index == _BY_NAME else f.parameters.name_at(index)
    if name is None or name not in f.parameters:
        f.ignored += 1
        return
    f.say("PARAM_VALUE", f.parameters.value_message(name))


def param_set(f: Firmware, message: Message) -> None:
    """PARAM_SET, answered by the value that holds then."""
    name = message.fields["param_id"]
    if name not in f.parameters:
        f.ignored += 1
        return
    if not f.parameters.set_from_wire(name, message.fields["param_value"]):
        f.ignored += 1
    f.say("PARAM_VALUE", f.parameters.value_message(name))


def request_data_stream(f: Firmware, message: Message) -> None:
    """REQUEST_DATA_STREAM."""
    rate = message.fields["req_message_rate"] if message.fields["start_stop"] else 0
    f.data_stream(message.fields["req_stream_id"], 1.0 / min(rate, MAX_RATE_HZ) if rate else None)


def file_transfer(f: Firmware, message: Message) -> None:
    """FILE_TRANSFER_PROTOCOL: refused at once, so that a client needn't wait before it asks for a
    list."""
    asked = message.fields["payload"]
    sequence = (asked[0] | asked[1] << 8) + 1 & 0xFFFF
    answer = (
        [sequence & 0xFF, sequence >> 8, asked[2], _FTP_NAK, 1, asked[3]]
        + [0] * 6
        + [_FTP_UNKNOWN_COMMAND]
    )
    to = {
        "target_network": 0,
        "target_system": message.source[0],
        "target_component": message.source[1],
    }
    if asked[3] < _FTP_NAK - 1:  # never answer an answer
        payload = answer + [0] * (len(asked) - len(answer))
        f.say("FILE_TRANSFER_PROTOCOL", to | {"payload": payload}, private=True)


_FTP_NAK, _FTP_UNKNOWN_COMMAND = 129, 7


def timesync(f: Firmware, message: Message) -> None:
    """TIMESYNC: a request (tc1 = 0) is answered with our time since boot."""
    if message.fields["tc1"] == 0:
        own_ns = round((f.now - f.boot_s) * 1e9)
        f.say("TIMESYNC", {"tc1": own_ns, "ts1": message.fields["ts1"]}, private=True)


HANDLERS: Mapping[str, Callable[[Firmware, Message], None]] = {
    "HEARTBEAT": heartbeat,
    "COMMAND_LONG": command,
    "COMMAND_INT": command,
    "SET_MODE": set_mode,
    "SET_POSITION_TARGET_LOCAL_NED": set_position_target,
    "SET_POSITION_TARGET_GLOBAL_INT": guided.set_global_target,
    "PARAM_REQUEST_LIST": param_list,
    "PARAM_REQUEST_READ": param_read,
    "PARAM_SET": param_set,
    "REQUEST_DATA_STREAM": request_data_stream,
    "MISSION_REQUEST_LIST": mission_lists.request_list,
    "MISSION_REQUEST": mission_lists.request_item,
    "MISSION_REQUEST_INT": mission_lists.request_item,
    "MISSION_COUNT": mission_lists.count,
    "MISSION_ITEM": mission_lists.item,
    "MISSION_ITEM_INT": mission_lists.item,
    "MISSION_CLEAR_ALL": mission_lists.clear,
    "MISSION_SET_CURRENT": mission_lists.set_current,
    "MISSION_ACK": mission_lists.answered,
    "FILE_TRANSFER_PROTOCOL": file_transfer,
    "TIMESYNC": timesync,
}
_NAN_HAS_MEANING = frozenset(
    {
        "COMMAND_LONG",
        "COMMAND_INT",
        "PARAM_SET",
        "SET_POSITION_TARGET_LOCAL_NED",
        "SET_POSITION_TARGET_GLOBAL_INT",
    }
    | {"MISSION_ITEM", "MISSION_ITEM_INT"}
)
"""Ignored axes, defaults, and PX4's integers in float clothes: their handlers look for
themselves."""


def sane(message: Message) -> bool:
    """Whether all numbers are finite, in messages in which others mean nothing."""
    if message.name in _NAN_HAS_MEANING:
        return True
    return all(math.isfinite(v) for v in message.fields.values() if isinstance(v, float))
