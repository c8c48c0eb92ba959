"""How an agent knows that its parent, the process that started it, still lives."""

from __future__ import annotations

import os
import select
import signal
import sys
from multiprocessing.connection import Connection
from typing import Final, Protocol

READY: Final = "ready"
"""First word on the lifeline once link and mesh are open; another one is why it did not start."""
ALIVE: Final = "alive"
"""Said with every status, so that a hung agent is noticed."""


class Lifeline(Protocol):
    """An agent's end of the line to its parent."""

    def cut(self) -> bool:
        """True once the parent is gone, or a signal has asked the agent to land."""

    def tell(self, text: str) -> None:
        """Say one word to the parent, if it is there."""


class PipeLifeline:
    """A pipe to the parent: its end of file is the parent's death."""

    def __init__(self, connection: Connection) -> None:
        os.set_blocking(connection.fileno(), False)
        self._connection = connection
        self._ready = select.poll()  # `connection.poll` makes one anew each time
        self._ready.register(connection, select.POLLIN)
        self._cut = False

    def cut(self) -> bool:
        try:
            while not self._cut and self._ready.poll(0):
                self._connection.recv_bytes()  # the parent has nothing to say
        except (EOFError, OSError):
            self._cut = True
        return self._cut

    def tell(self, text: str) -> None:
        try:
            self._connection.send(text)
        except BlockingIOError:
            pass  # a parent that does not read must not stop the control loop
        except OSError:
            self._cut = True


class SignalLifeline:
    """Of an agent started alone from a terminal: SIGINT, SIGTERM and SIGHUP land it."""

    def __init__(self) -> None:
        self._cut = False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._signalled)

    def _signalled(self, *_: object) -> None:
        self._cut = True

    def cut(self) -> bool:
        return self._cut

    def tell(self, text: str) -> None:
        if text != ALIVE:
            sys.stderr.write(f"agent: {text}\n")
