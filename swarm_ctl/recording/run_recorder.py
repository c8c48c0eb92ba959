"""Records a run for the station: all messages as MCAP; events, commands with their acks, and
statuses as JSON lines too, for the summary."""

from __future__ import annotations

import contextlib
import errno
import json
import os
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from swarm_ctl.core.model.messages import Ack, AgentStatus, Command, Event, Outcome, Payload
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.rim import Rim, Trouble

TROUBLES: Final = "troubles.jsonl"
"""What of all that only shows went wrong at the station, one JSON object a line; no file: all
went well."""
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
        self.rim = Rim(path.name, most=1)

    def write(self, data: bytes) -> None:
        self.rim.run(self._write, data + b"\n")

    def _write(self, line: bytes) -> None:
        if self._file.write(line) < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

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
        self.rims = (*mcap.rims, *(lines.rim for lines in self._lines))
        """Of all that may fail here."""
        self._folder = folder
        self._adapter = TypeAdapter(object)
        self._due: dict[int, float] = {}
        self._zones: dict[int, tuple[Zone, ...] | None] = {}
        """By agent, as its last status in the file has them."""
        self._last_s = 0.0

    def take(self, payload: Payload, received_s: float) -> None:
        """Record a message; `statuses.jsonl` gets some of the statuses, those that name other zones
        than before, and the last one."""
        self._last_s = received_s
        self._mcap.take(payload, received_s)
        match payload:
            case Event():
                self._events.write(self._adapter.dump_json(payload))
            case Command() | Ack():
                self._commands.write(self._adapter.dump_json(payload))
            case AgentStatus() if self._is_due(payload, received_s):
                self._statuses.write(self._adapter.dump_json(payload))

    def _is_due(self, status: AgentStatus, received_s: float) -> bool:
        """By the own clock: one status from far ahead silences none that come after it."""
        goes_on = status.outcome is Outcome.RUNNING and status.zones == self._zones.get(
            status.agent
        )
        if goes_on and received_s < self._due.get(status.agent, 0.0):
            return False
        self._zones[status.agent] = status.zones
        every_s = min(_MOST_S, _STATUS_S * max(1.0, len(self._due) / _FEW))
        self._due[status.agent] = received_s + every_s
        return True

    def note(self, trouble: Trouble, time_s: float) -> None:
        """Keep it for the summary."""
        line = {"time_s": round(time_s, 3), "part": trouble.part, "why": trouble.why}
        with (self._folder / TROUBLES).open("ab", buffering=0) as file:
            file.write(json.dumps(line | {"off": trouble.off}).encode() + b"\n")

    def close(self) -> None:
        """Write what waits, what went wrong at that too, and close the files."""
        for lines in self._lines:
            lines.close()
        self._mcap.close()
        left = [trouble for rim in self.rims for trouble in rim.troubles()]
        with contextlib.suppress(OSError):
            for trouble in left:
                self.note(trouble, self._last_s)
