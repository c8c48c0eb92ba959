"""Records a run for the station: all messages as MCAP; events, commands with their acks, and
statuses as JSON lines too, for the summary."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from swarm_ctl.core.model.messages import Ack, AgentStatus, Command, Event, Outcome, Payload
from swarm_ctl.recording.mcap_reader import RECORDING
from swarm_ctl.recording.mcap_recorder import McapRecorder

_STATUS_S: Final = 2.0
"""Mission time between two statuses of an agent in `statuses.jsonl`, of up to `_FEW` agents; of
more in proportion, so that the file grows no faster."""
_FEW: Final = 16
_MOST_S: Final = 5.0
"""`run` takes a killed agent's successor for ended 10 s after the last of its statuses there."""


class _Lines:
    """A file that grows by whole JSON lines; a full disk ends the file, not the station."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("ab", buffering=0)
        self.name = path.name
        self.failure = ""

    def write(self, data: bytes) -> None:
        if self.failure:
            return
        try:
            if self._file.write(data + b"\n") <= len(data):
                self.failure = os.strerror(errno.ENOSPC)
        except OSError as error:
            self.failure = error.strerror or str(error)

    def close(self) -> None:
        self._file.close()


class RunRecorder:
    """Records what a station hears and sends."""

    def __init__(self, folder: Path, mcap: McapRecorder) -> None:
        self._mcap = mcap
        self._events = _Lines(folder / "events.jsonl")
        self._commands = _Lines(folder / "commands.jsonl")
        self._statuses = _Lines(folder / "statuses.jsonl")
        self._lines = (self._events, self._commands, self._statuses)
        self._reported: set[str] = set()
        self._adapter = TypeAdapter(object)
        self._due: dict[int, float] = {}

    def take(self, payload: Payload, received_s: float) -> None:
        """Record a message; `statuses.jsonl` gets some of the statuses, and the last one."""
        self._mcap.take(payload, received_s)
        match payload:
            case Event():
                self._events.write(self._adapter.dump_json(payload))
            case Command() | Ack():
                self._commands.write(self._adapter.dump_json(payload))
            case AgentStatus() if self._is_due(payload):
                self._statuses.write(self._adapter.dump_json(payload))

    def _is_due(self, status: AgentStatus) -> bool:
        if status.outcome is Outcome.RUNNING and status.time_s < self._due.get(status.agent, 0.0):
            return False
        every_s = min(_MOST_S, _STATUS_S * max(1.0, len(self._due) / _FEW))
        self._due[status.agent] = status.time_s + every_s
        return True

    def troubles(self) -> list[str]:
        """The files that can't be written any more, and why: each once."""
        files = {lines.name: lines.failure for lines in self._lines}
        files[RECORDING] = self._mcap.failure
        files["Foxglove's view in " + RECORDING] = self._mcap.underived
        new = {name: why for name, why in files.items() if why and name not in self._reported}
        self._reported |= new.keys()
        end = "the flight goes on"
        return [f"{name} is not written any more: {why}; {end}" for name, why in new.items()]

    def close(self) -> None:
        """Write what waits and close the files."""
        for lines in self._lines:
            lines.close()
        self._mcap.close()
