"""What a child and its parent, the process that started it, know of each other: the parent's end is
the end of the child's lifeline; the child says lines of text: `READY`, or why it does not start,
then notes for the operator, and `ALIVE`."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final, Protocol

from swarm_ctl.engine.clock import wall_s
from swarm_ctl.errors import StartError
from swarm_ctl.signals import ENDING, said_of

READY: Final = "ready"
"""First word on the lifeline once link and mesh are open; another one is why it did not start."""
GONE: Final = "the process that started this agent is gone"
ALIVE: Final = "alive"
"""Said with every status, so that a hung agent is noticed."""
ALIVE_FILE: Final = "SWARM_CTL_ALIVE"
"""The variable that names the file of a container's health check."""
_TOUCH_WALL_S: Final = 1.0
_LONGEST: Final = 4096
"""Bytes of a word that is told: it goes into a pipe whole, or not at all."""
_HEARD: Final = 1 << 16
"""Of one that is heard: the simulator names all its vehicles in one."""


class Lifeline(Protocol):
    """An agent's end of the line to its parent."""

    def cut(self) -> str:
        """Why the agent is to land: the parent is gone, or the signal that asks for it; '' before
        that."""

    def tell(self, text: str) -> None:
        """Say one word to the parent, if it is there."""


class ChildWords:
    """What a child tells, at its parent's end of the pipe: lines of text, and never a pickle, which
    could run code here. It never waits: a child may stop within a line. `spoken`: what is a word of
    ours, of a child that speaks otherwise."""

    def __init__(self, connection: Connection, spoken: Callable[[str], str] = str) -> None:
        os.set_blocking(connection.fileno(), False)
        self._spoken = spoken
        self._connection = connection
        self._heard = b""

    def next(self) -> str | None:
        """The next word; None: there is none now, or the child has closed its end."""
        try:
            while b"\n" not in self._heard and len(self._heard) < _HEARD:
                data = os.read(self._connection.fileno(), _HEARD)
                if not data:
                    break
                self._heard += data
        except OSError:  # nothing more now; it is closed
            pass
        word, end, rest = self._heard.partition(b"\n")
        if not end and len(word) < _HEARD:
            return None
        self._heard = rest
        return self._spoken(word[:_HEARD].decode(errors="replace"))


class PipeLifeline:
    """From the parent, and to it: two descriptors, or one of both. The first one's end of file is
    the parent's death."""

    def __init__(self, hears: int, says: int) -> None:
        for descriptor in (hears, says):
            os.set_blocking(descriptor, False)
        self._hears, self._says = hears, says
        self._ready = select.poll()
        self._ready.register(hears, select.POLLIN)
        self._cut = ""

    def cut(self) -> str:
        try:
            while not self._cut and self._ready.poll(0):
                if not os.read(self._hears, _LONGEST):  # the parent has nothing to say
                    self._cut = GONE
        except OSError:
            self._cut = GONE
        return self._cut

    def tell(self, text: str) -> None:
        line = " ".join(text[:_LONGEST].split("\n")).encode()[: _LONGEST - 1]
        try:
            os.write(self._says, line + b"\n")
        except BlockingIOError:
            pass  # a parent that does not read must not stop the control loop
        except OSError:
            self._cut = GONE


def sign_of_life() -> Callable[[], None]:
    """What a process calls in its loop that a container's health check looks at: it touches the
    file that SWARM_CTL_ALIVE names, once a second; nothing where that is not set.

    StartError where the file can't be written.
    """
    name = os.environ.get(ALIVE_FILE)
    if not name:
        return lambda: None
    path, due_s = Path(name), 0.0
    try:
        path.touch()
    except OSError as error:
        raise StartError(f"{ALIVE_FILE}={name}: can't be written: {error.strerror}") from None

    def touch() -> None:
        nonlocal due_s
        if wall_s() >= due_s:
            due_s = wall_s() + _TOUCH_WALL_S
            with contextlib.suppress(OSError):  # the check fails then, and the flight goes on
                path.touch()

    return touch


class SignalLifeline:
    """Of an agent started alone from a terminal: SIGINT, SIGTERM and SIGHUP land it."""

    def __init__(self) -> None:
        self._cut = ""
        self._alive = sign_of_life()
        for number in ENDING:
            signal.signal(number, self._signalled)

    def _signalled(self, number: int, _: object) -> None:
        self._cut = self._cut or said_of(number)

    def cut(self) -> str:
        return self._cut

    def tell(self, text: str) -> None:
        self._alive()
        if text != ALIVE:
            with contextlib.suppress(OSError):  # the terminal was closed
                sys.stderr.write(f"agent: {text}\n")
