"""Ctrl-C, SIGTERM and a closed terminal as counts: what flies brings its vehicles down first."""

from __future__ import annotations

import errno
import os
import select
import signal
from typing import Final, Self

from swarm_ctl.core.model.text import escaped
from swarm_ctl.engine.clock import wall_s
from swarm_ctl.signals import ENDING, said_of

_ONE_PRESS_WALL_S: Final = 0.7
"""A Ctrl-C so soon after another one is the same: a key that is held, or `timeout -s INT`, which
sends it to its child and to its child's group."""


_GONE: Final = "the program that started it is gone"


class Interrupts:
    """Counts these signals while it is entered; `lifeline`: a pipe from the program that
    started this process; a word on it counts as one, and so does its end."""

    def __init__(self, lifeline: int | None = None) -> None:
        self._lifeline = lifeline
        self._count = 0
        self.first = ""
        """What the first one says: "Ctrl-C"; '' before it."""
        self.presses = 0
        """Of them, how often Ctrl-C."""
        self.again = False
        """Ctrl-C was pressed a second time. Of the other signals a second one says no more: a
        closed terminal and a service manager send several."""
        self._pressed_s: float | None = None

    @property
    def count(self) -> int:
        """How many came until now."""
        if self._lifeline is not None and (words := _heard(self._lifeline)):
            self._lifeline = None
            self._count += 1
            self.first = self.first or words
        return self._count

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._take) for number in ENDING}
        return self

    def _take(self, number: int, _: object) -> None:
        self._count += 1
        self.first = self.first or said_of(number)
        if number == signal.SIGINT:
            self.presses += 1
            now, before = wall_s(), self._pressed_s
            self.again |= before is not None and now - before > _ONE_PRESS_WALL_S
            self._pressed_s = now
        elif signal.Signals(number).name == "SIGHUP":
            _leave_terminal()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


def _heard(pipe: int) -> str:
    """A word on it, or that it was closed; '' for neither."""
    if not select.select([pipe], [], [], 0)[0]:
        return ""
    return escaped(os.read(pipe, 80).decode(errors="replace")) or _GONE


def _leave_terminal() -> None:
    """What is still said goes nowhere, instead of failing."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        if os.isatty(descriptor) or (descriptor and _gone(descriptor)):
            os.dup2(nowhere, descriptor)
    os.close(nowhere)


def _gone(descriptor: int) -> bool:
    """A terminal that was hung up: it is none any more."""
    try:
        os.tcgetpgrp(descriptor)
    except OSError as error:
        return error.errno == errno.EIO  # of a file or a pipe: ENOTTY
    return False
