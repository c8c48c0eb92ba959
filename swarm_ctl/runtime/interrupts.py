"""The signals that end a program: Ctrl-C, SIGTERM, a closed terminal. A command is ended by them in
one line; what flies counts them and brings its vehicles down; its children hear none."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
from collections.abc import Iterator
from typing import Final, NoReturn, Self

from swarm_ctl.runtime.clock import wall_s

ENDED_CODE: Final = 130
"""Exit code of what was ended by one of them."""
_WORDS: Final = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "the terminal was closed"}
ENDING: Final = tuple(getattr(signal, name) for name in _WORDS if hasattr(signal, name))
_ONE_PRESS_WALL_S: Final = 0.7
"""A Ctrl-C so soon after another one is the same: a key that is held, or `timeout -s INT`, which
sends it to its child and to its child's group."""


def said_of(number: int) -> str:
    """What a signal says, for a verdict."""
    return _WORDS[signal.Signals(number).name]


def ended_in_one_line() -> None:
    """From here on each of these signals ends this process in one line, with `ENDED_CODE`: as an
    exception, so that all that is open is closed. A second one ends it at once."""
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:  # `nohup`, or a shell's background
            signal.signal(number, _end)


def _end(number: int, _: object) -> NoReturn:
    for each in ENDING:
        signal.signal(each, signal.SIG_DFL)
    with contextlib.suppress(OSError):  # the terminal is gone
        os.write(2, f"ended: {said_of(number)}\n".encode())
    raise SystemExit(ENDED_CODE)


def ended() -> None:
    """The command's result stands: no signal changes it any more."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


@contextlib.contextmanager
def deaf_children() -> Iterator[None]:
    """Processes that are started meanwhile never hear these signals, from their first instruction
    on, nor do their own children: only what started them ends them. A terminal sends Ctrl-C and its
    own end to all processes in it. What comes meanwhile, this process hears afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def hears(*numbers: int) -> None:
    """This process hears these again, though it was started by `deaf_children`."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


class Interrupts:
    """Counts these signals while it is entered."""

    def __init__(self) -> None:
        self.count = 0
        self.first = ""
        """What the first one says: "Ctrl-C"; '' before it."""
        self.presses = 0
        """Of them, how often Ctrl-C."""
        self.again = False
        """Ctrl-C was pressed a second time. Of the other signals a second one says no more: a
        closed terminal and a service manager send several."""
        self._pressed_s: float | None = None

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._take) for number in ENDING}
        return self

    def _take(self, number: int, _: object) -> None:
        self.count += 1
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
