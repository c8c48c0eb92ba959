"""QGroundControl as its vehicles see it when it connects: a client that plays its initial steps,
with its time-outs and its resends, for all vehicles on one port.

By QGroundControl's sources: InitialConnectStateMachine, StandardModes,
RequestMetaDataTypeStateMachine, ParameterManager, PlanManager.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.mavlink.framer import Framer, MavlinkFrame

ACK_S, TRIES = 1.2, 3
"""MAVLink commands are asked again so often."""
MODES_S = 5.0
"""An autopilot sends its modes one by one; ArduCopter 4.7-dev, the first alone."""
PARAMETERS_S = 3.0
"""Without a new value for so long, those that are missing are asked for by index."""
AVAILABLE_MODES, COMPONENT_METADATA, COMPONENT_INFORMATION = 435, 397, 395
"""Newer than pymavlink's dialect."""
LOST = 10
PARAMETER_FILE = b"@PARAM/param.pck"
OPEN_FILE, NAK, NO_SUCH_FILE = 4, 129, 10
PROTOCOL_VERSION_COMMAND = 519
STREAMS = {1: 2, 2: 2, 3: 2, 6: 3, 10: 10, 11: 10, 12: 3}
"""REQUEST_DATA_STREAM for an ArduPilot: stream and rate."""


Item = tuple[int, int, int, int, float]
"""Command, frame, x, y (1e-7 degrees), z [m]."""


class HandshakeError(Exception):
    """A step did not end as QGroundControl wants; the text names it."""


class QGroundControl:
    """Listens on a port, as system 255."""

    def __init__(self, port: int = 0, system: int = 255) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self.port = int(self._socket.getsockname()[1])
        self._mav = mavlink.MAVLink(None, system, 190)
        self._decoder = mavlink.MAVLink(None)
        self._framer = Framer(unknown=True)
        self._waiting: deque[MavlinkFrame] = deque()
        self._to: Any = None
        self._heartbeat_s = 0.0
        self.retries: list[str] = []
        """What had to be asked for again."""
        self.vehicles: dict[int, Any] = {}
        """The newest HEARTBEAT of each system."""

    def close(self) -> None:
        self._socket.close()

    def tell(self, message: Any) -> None:
        if self._to is not None:
            self._socket.sendto(message.pack(self._mav), self._to)

    def listen(self, seconds: float) -> Iterator[tuple[MavlinkFrame, Any]]:
        """Frames and, where the dialect has them, messages; heartbeats go out meanwhile."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            if time.monotonic() - self._heartbeat_s >= 1.0:
                self._heartbeat_s = time.monotonic()
                self.tell(mavlink.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3))
            self._socket.settimeout(min(left, 0.1))
            if not self._waiting:
                with contextlib.suppress(TimeoutError):
                    data, self._to = self._socket.recvfrom(65535)
                    self._waiting += self._framer.feed(data)
            while self._waiting:  # also those that a listener before did not wait for
                frame = self._waiting.popleft()
                message = None
                with contextlib.suppress(mavlink.MAVError):
                    message = self._decoder.decode(bytearray(frame.raw))
                if message is not None and message.get_type() == "HEARTBEAT":
                    self.vehicles[frame.system] = message
                yield frame, message

    def find(self, count: int, seconds: float = 30.0) -> list[int]:
        """The system ids, once so many vehicles are heard."""
        for _ in self.listen(seconds):
            if len(self.vehicles) >= count:
                return sorted(self.vehicles)
        raise HandshakeError(f"{count} vehicles wanted, heard {sorted(self.vehicles)}")

    def write_plan(self, system: int, kind: int, items: list[Item]) -> None:
        """Send a list of items as the vehicle asks for them."""
        count = mavlink.MAVLink_mission_count_message(system, 1, len(items), kind)
        for _ in range(TRIES):
            self.tell(count)
            for frame, message in self.listen(ACK_S):
                name = "" if message is None else message.get_type()
                if frame.system != system or not name.startswith("MISSION_"):
                    continue
                if name in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                    command, where, x, y, z = items[message.seq]
                    head = (system, 1, message.seq, where, command, 0, 1, 0, 0, 0, 0)
                    self.tell(mavlink.MAVLink_mission_item_int_message(*head, x, y, z, kind))
                elif name == "MISSION_ACK" and message.type == 0:
                    return
        raise HandshakeError(f"vehicle {system} did not take plan {kind}")

    def connect(self, system: int) -> Vehicle:
        """Every step for one vehicle."""
        return Vehicle(self, system)


class Vehicle:
    """One vehicle once QGroundControl has connected: what it has learned, step by step."""

    def __init__(self, qgc: QGroundControl, system: int) -> None:
        self._qgc = qgc
        self.system = system
        self.is_ardupilot = qgc.vehicles[system].autopilot == 3
        if self.is_ardupilot:
            for stream, rate in STREAMS.items():
                qgc.tell(mavlink.MAVLink_request_data_stream_message(system, 1, stream, rate, 1))
        self.version = self._message(148)
        self.modes = self._modes()
        self.metadata = self._result(512, COMPONENT_METADATA)
        self.information = self._result(512, COMPONENT_INFORMATION)
        self.protocol = self._result(PROTOCOL_VERSION_COMMAND, 1)
        self.parameters = self._parameters()
        self.mission = self._plan(0)
        self.fence = self._plan(1)
        self.rally = self._plan(2)
        self.home = self._message(242)

    def _ask(
        self, what: str, ask: Callable[[], None], wanted: Callable[[MavlinkFrame, Any], bool]
    ) -> Any:
        """Ask up to three times; the message (or, if the dialect lacks it, the frame)."""
        for attempt in range(TRIES):
            if attempt:
                self._qgc.retries.append(f"{what} of vehicle {self.system}")
            ask()
            for frame, message in self._qgc.listen(ACK_S):
                if frame.system == self.system and wanted(frame, message):
                    return message or frame
        raise HandshakeError(f"vehicle {self.system}: no answer to {what}")

    def _command(self, number: int, *p: float) -> None:
        numbers = [*p, *[0.0] * (7 - len(p))]
        self._qgc.tell(mavlink.MAVLink_command_long_message(self.system, 1, number, 0, *numbers))

    def _result(self, command: int, *p: float) -> int:
        """MAV_RESULT of a command."""

        def is_answer(_: MavlinkFrame, message: Any) -> bool:
            is_ack = message is not None and message.get_type() == "COMMAND_ACK"
            return is_ack and message.command == command and message.target_system == 255

        asked = f"command {command} {p}"
        answer = self._ask(asked, lambda: self._command(command, *p), is_answer)
        return int(answer.result)

    def _message(self, number: int) -> Any:
        """By REQUEST_MESSAGE: the vehicle's acceptance, and the message, in any order."""
        seen: dict[str, Any] = {}

        def both(frame: MavlinkFrame, message: Any) -> bool:
            if frame.message_id == number:
                seen["message"] = message
            elif _result_of_request(message) == 0:
                seen["ack"] = message
            return len(seen) == 2

        self._ask(f"message {number}", lambda: self._command(512, number), both)
        return seen["message"]

    def _modes(self) -> int:
        """AVAILABLE_MODES: how many have come; 0 where the vehicle declines, and QGroundControl
        uses those that it knows of the firmware."""
        found: set[int] = set()
        answers: list[int] = []
        total = 256

        def answered(frame: MavlinkFrame, message: Any) -> bool:
            nonlocal total
            if frame.message_id == AVAILABLE_MODES:
                total = frame.raw[18]  # behind two uint32
                found.add(frame.raw[19])
            elif (result := _result_of_request(message)) is not None:
                answers.append(result)
            return bool(answers)

        self._ask("modes", lambda: self._command(512, AVAILABLE_MODES, 0), answered)
        if answers[0] != 0:
            return 0
        for frame, message in self._qgc.listen(MODES_S):
            if frame.system == self.system:
                answered(frame, message)
            if len(found) >= total:
                break
        return len(found)

    def _parameters(self) -> dict[str, float]:
        """By file for an ArduPilot that has one (its content is not read here); then the list, and
        what is missing of it by index. Some values are lost once, as on a radio."""
        if self.is_ardupilot:
            self.parameter_file = self._opens_parameter_file()
        request = mavlink.MAVLink_param_request_list_message(self.system, 0)
        values: dict[int, tuple[str, float]] = {}
        lost: set[int] = set()
        total: int | None = None
        for _ in range(30):
            if total is None:
                self._qgc.tell(request)
            else:
                for index in [i for i in range(total) if i not in values][:10]:
                    self._qgc.tell(
                        mavlink.MAVLink_param_request_read_message(self.system, 1, b"", index)
                    )
            quiet_s = time.monotonic() + PARAMETERS_S
            while time.monotonic() < quiet_s and len(values) != total:
                for frame, message in self._qgc.listen(0.2):
                    if frame.system != self.system or message is None:
                        continue
                    if message.get_type() != "PARAM_VALUE" or message.param_index == 65535:
                        continue
                    quiet_s = time.monotonic() + (0.3 if lost else PARAMETERS_S)
                    total, index = message.param_count, message.param_index
                    if index % 7 == 3 and index not in lost and len(lost) < LOST:
                        lost.add(index)
                    else:
                        values[index] = (message.param_id, message.param_value)
            if len(values) == total:
                return dict(values.values())
        raise HandshakeError(f"vehicle {self.system}: {len(values)} of {total} parameters")

    def _opens_parameter_file(self) -> bool:
        """Whether the vehicle has one; a refusal names the file as missing."""
        data = [1, 0, 0, OPEN_FILE, len(PARAMETER_FILE), 0, 0, 0, 0, 0, 0, 0, *PARAMETER_FILE]
        payload = data + [0] * (251 - len(data))
        asked = mavlink.MAVLink_file_transfer_protocol_message(0, self.system, 1, payload)
        try:
            answer = self._ask(
                "the parameter file",
                lambda: self._qgc.tell(asked),
                lambda _, m: m is not None and m.get_type() == "FILE_TRANSFER_PROTOCOL",
            )
        except HandshakeError:  # QGroundControl goes on to the list; `retries` tells of it
            return False
        if answer.payload[3] == NAK and answer.payload[12] != NO_SUCH_FILE:
            raise HandshakeError(f"vehicle {self.system}: file refused by {answer.payload[12]}")
        return bool(answer.payload[3] != NAK)

    def _plan(self, kind: int) -> list[Any]:
        """The items of a mission (0), fence (1) or rally points (2)."""

        def of(name: str) -> Callable[[MavlinkFrame, Any], bool]:
            return lambda _, m: m is not None and m.get_type() == name and m.mission_type == kind

        ask = mavlink.MAVLink_mission_request_list_message(self.system, 1, kind)
        count = self._ask(f"plan {kind}", lambda: self._qgc.tell(ask), of("MISSION_COUNT")).count
        items = []
        for seq in range(count):
            wanted = mavlink.MAVLink_mission_request_int_message(self.system, 1, seq, kind)
            item = self._ask(
                f"item {seq} of plan {kind}",
                lambda wanted=wanted: self._qgc.tell(wanted),  # type: ignore[misc]
                lambda f, m, seq=seq: of("MISSION_ITEM_INT")(f, m) and m.seq == seq,  # type: ignore[misc]
            )
            items.append(item)
        self._qgc.tell(mavlink.MAVLink_mission_ack_message(self.system, 1, 0, kind))
        return items


def _result_of_request(message: Any) -> int | None:
    """MAV_RESULT of REQUEST_MESSAGE; None: the message is no answer to it."""
    if message is None or message.get_type() != "COMMAND_ACK" or message.command != 512:
        return None
    return int(message.result)
