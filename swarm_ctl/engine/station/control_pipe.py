"""What `run` and its station tell each other: JSON lines on a pipe. The pipe's end is the other
one's end."""

from __future__ import annotations

import contextlib
import json
import os
from typing import Any


class ControlPipe:
    """The reading end of a pipe, polled; never blocks."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self.closed = False
        os.set_blocking(descriptor, False)

    def poll(self) -> list[dict[str, Any]]:
        """All whole messages since the last call; what is no JSON object is ignored. Sets `closed`
        at the end."""
        while not self.closed:
            try:
                data = os.read(self._descriptor, 65536)
            except BlockingIOError:
                break
            self._rest += data
            self.closed = not data
        *lines, self._rest = self._rest.split(b"\n")
        messages = []
        for line in lines:
            with contextlib.suppress(ValueError):
                message = json.loads(line)
                if isinstance(message, dict):
                    messages.append(message)
        return messages
