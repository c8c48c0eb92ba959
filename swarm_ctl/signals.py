"""The signals that end a program: Ctrl-C, SIGTERM, a closed terminal. They end a command in one
line, and what it starts hears none."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from typing import Final, NoReturn

ENDED_CODE: Final = 130
"""Exit code of what was ended by one of them."""
_WORDS: Final = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "the terminal was closed"}
ENDING: Final = tuple(getattr(signal, name) for name in _WORDS if hasattr(signal, name))


def said_of(number: int) -> str:
    """What a signal says, for a verdict."""
    return _WORDS[signal.Signals(number).name]


def ended_in_one_line() -> None:
    """From here on each of these signals ends this process in one line, with `ENDED_CODE`: as an
    exception, so that all that is open is closed. A second one ends it at once."""
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:  # `nohup`, or a shell's background
            signal.signal(number, _end)


@contextlib.contextmanager
def ended_by(leave: Callable[[], None]) -> Iterator[None]:
    """Meanwhile such a signal calls `leave`, and ends the process in one line behind the block: an
    exception in the midst of another's event loop may be lost there."""
    came: list[int] = []

    def take(number: int, _: object) -> None:
        came.append(number)
        leave()

    before = {number: signal.signal(number, take) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        _end(came[0], None)


_ended_by: list[int] = []


def is_ended() -> bool:
    """One of them has ended this process, which is on its way out."""
    return bool(_ended_by)


def _end(number: int, _: object) -> NoReturn:
    _ended_by.append(number)
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


def deaf_tracker() -> None:
    """Start multiprocessing's resource tracker so, before the processes that want it: it lets
    signals through again behind itself."""
    from multiprocessing import resource_tracker

    with deaf_children():
        resource_tracker.ensure_running()


def hears(*numbers: int) -> None:
    """This process hears these again, though it was started by `deaf_children`."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)
