"""The messages every MAVLink vehicle serves, as a table from name to function. Pure.

A message that isn't in the table, not for this system, or makes no sense is counted by
`Firmware.handle` or here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.message import MavResult, Message
from swarm_sim.firmware.protocol import commands
from swarm_sim.firmware.protocol.commands import MAX_RATE_HZ, read_command
from swarm_sim.firmware.protocol.telemetry import readings

SET_MODE_ID = 11
"""PX4 acknowledges the legacy SET_MODE message as a command with its own message id."""
_ARDUPILOT = 3
"""MAV_AUTOPILOT."""
_BY_NAME = -1
"""PARAM_REQUEST_READ.param_index when the name counts."""
_FTP_NAK, _FTP_FAIL, _FTP_UNKNOWN_COMMAND = 129, 128, 7
_FTP_OPEN, _FTP_NO_SUCH_FILE = 4, 10
"""QGroundControl asks an ArduPilot for a file of all parameters; it goes on to PARAM_REQUEST_LIST
at once where there is no such file, and after 5 s where anything else is wrong."""


def heartbeat(a: SimAutopilot, message: Message) -> None:
    """A ground station's keeps the vehicle from its failsafe."""
    if a.is_gcs(message.source[0], message.fields["type"]):
        a.gcs_heartbeat()


def command(a: SimAutopilot, message: Message) -> None:
    """COMMAND_LONG, COMMAND_INT."""
    asked = read_command(message)
    if not a.addressed(asked):
        a.ignored += 1
        return
    handler = a.commands.get(asked.id)
    if handler is None:
        result = a.merely_answered.get(asked.id, MavResult.UNSUPPORTED)
    else:
        result = handler(a, asked)
    if result is not None:
        a.acknowledge(asked.id, result, asked.source)


def mission(a: SimAutopilot, message: Message) -> None:
    """As the persona's mission protocol does; it may leave a message unanswered."""
    serve = a.mission_services.get(message.name)
    if serve is None:
        a.ignored += 1
    else:
        serve(a, message)


def set_mode(a: SimAutopilot, message: Message) -> None:
    result = a.set_mode(message.fields["base_mode"], message.fields["custom_mode"])
    if a.autopilot != _ARDUPILOT:
        a.acknowledge(SET_MODE_ID, result, message.source)


def param_request_list(a: SimAutopilot, _: Message) -> None:
    """The values follow a few at a time."""
    channel = a.asked_on or 0
    others = [pending for pending in a.pending_parameters if pending[0] != channel]
    a.pending_parameters.clear()
    a.pending_parameters.extend([*others, *((channel, name) for name in a.parameters.names)])


def param_request_read(a: SimAutopilot, message: Message) -> None:
    index = message.fields["param_index"]
    name = message.fields["param_id"] if index == _BY_NAME else a.parameters.name_at(index)
    if name is None or name not in a.parameters:
        a.ignored += 1
        return
    a.say("PARAM_VALUE", a.parameters.value_message(name), channel=a.asked_on)


def param_set(a: SimAutopilot, message: Message) -> None:
    """Answered by the value that holds then."""
    name, value = message.fields["param_id"], message.fields["param_value"]
    known = name in a.parameters
    if known and not a.parameters.takes(name, message.fields["param_type"]):
        a.ignored += 1
        return
    if not known or not a.parameters.set_from_wire(name, value):
        a.ignored += 1
    if known:
        a.say("PARAM_VALUE", a.parameters.value_message(name))


def request_data_stream(a: SimAutopilot, message: Message) -> None:
    rate = message.fields["req_message_rate"] if message.fields["start_stop"] else 0
    a.data_stream(message.fields["req_stream_id"], 1.0 / min(rate, MAX_RATE_HZ) if rate else None)


def file_transfer(a: SimAutopilot, message: Message) -> None:
    """FILE_TRANSFER_PROTOCOL: refused at once, so that no client waits for a time-out."""
    asked = message.fields["payload"]
    if asked[3] >= _FTP_FAIL:  # never answer an answer
        return
    sequence = (asked[0] | asked[1] << 8) + 1 & 0xFFFF
    head = [sequence & 0xFF, sequence >> 8, asked[2], _FTP_NAK, 1, asked[3]]
    why = _FTP_NO_SUCH_FILE if asked[3] == _FTP_OPEN else _FTP_UNKNOWN_COMMAND
    answer = head + [0] * 6 + [why]
    fields = {
        "target_network": 0,
        "target_system": message.source[0],
        "target_component": message.source[1],
        "payload": answer + [0] * (len(asked) - len(answer)),
    }
    a.say("FILE_TRANSFER_PROTOCOL", fields, private=True)


def timesync(a: SimAutopilot, message: Message) -> None:
    """A request (tc1 = 0) is answered with our time since boot."""
    if message.fields["tc1"] == 0:
        own_ns = round((a.now - a.boot_s) * 1e9)
        a.say("TIMESYNC", {"tc1": own_ns, "ts1": message.fields["ts1"]}, private=True)


def version_request(a: SimAutopilot, _: Message) -> None:
    """AUTOPILOT_VERSION_REQUEST, which MAVProxy sends: ArduPilot's own message."""
    if a.autopilot == _ARDUPILOT:
        for fields in readings(a, "AUTOPILOT_VERSION"):
            a.say("AUTOPILOT_VERSION", fields, private=True)


def log_list(a: SimAutopilot, _: Message) -> None:
    """There are no logs: ArduPilot says so, but not while it is armed; PX4 says nothing."""
    if a.autopilot == _ARDUPILOT and not a.armed:
        a.say("LOG_ENTRY", {}, private=True)


def ping(a: SimAutopilot, message: Message) -> None:
    """A PX4 answers a question (a PING without a target) to its sender; an ArduCopter does not."""
    f = message.fields
    if a.autopilot != _ARDUPILOT and not (f["target_system"] or f["target_component"]):
        to = {"target_system": message.source[0], "target_component": message.source[1]}
        a.say("PING", {"time_usec": f["time_usec"], "seq": f["seq"]} | to, private=True)


HANDLERS: Mapping[str, Callable[[SimAutopilot, Message], None]] = {
    "HEARTBEAT": heartbeat,
    "COMMAND_LONG": command,
    "COMMAND_INT": command,
    "SET_MODE": set_mode,
    "SET_POSITION_TARGET_LOCAL_NED": commands.set_position_target,
    "SET_POSITION_TARGET_GLOBAL_INT": commands.set_position_target,
    "PARAM_REQUEST_LIST": param_request_list,
    "PARAM_REQUEST_READ": param_request_read,
    "PARAM_SET": param_set,
    "REQUEST_DATA_STREAM": request_data_stream,
    "MISSION_REQUEST_LIST": mission,
    "MISSION_REQUEST": mission,
    "MISSION_REQUEST_INT": mission,
    "MISSION_COUNT": mission,
    "MISSION_WRITE_PARTIAL_LIST": mission,
    "MISSION_ITEM": mission,
    "MISSION_ITEM_INT": mission,
    "MISSION_CLEAR_ALL": mission,
    "MISSION_SET_CURRENT": mission,
    "MISSION_ACK": mission,
    "AUTOPILOT_VERSION_REQUEST": version_request,
    "LOG_REQUEST_LIST": log_list,
    "PING": ping,
    "FILE_TRANSFER_PROTOCOL": file_transfer,
    "TIMESYNC": timesync,
}
_NAN_HAS_MEANING = frozenset(
    name
    for name in HANDLERS
    if name.startswith(("COMMAND_", "PARAM_SET", "SET_POSITION_TARGET_", "MISSION_ITEM"))
)
"""NaN may be an ignored axis, a default, or the bytes of an integer: their handlers judge it."""


def sane(message: Message) -> bool:
    """Whether all numbers are finite, in messages in which others mean nothing."""
    if message.name in _NAN_HAS_MEANING:
        return True
    return all(math.isfinite(v) for v in message.fields.values() if isinstance(v, float))
