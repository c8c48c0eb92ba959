"""The terminal as it was before a child took it over; put back where the child can't do it any
more."""

from __future__ import annotations

import contextlib
import os
import sys
import termios
from typing import Any, Final

_MODES: Final = "?2004l ?1000l ?1003l ?1015l ?1006l ?1004l <u ?7h ?25h ?1049l 0m"
"""No pasting, no mouse, no focus reports, plain keys, wrapping, a cursor, the normal screen, plain
colours."""
_LEAVE: Final = "".join(f"\x1b[{mode}" for mode in _MODES.split()).encode()


class TerminalState:
    """The state of stdin's terminal when this was made; nothing where stdin is no terminal."""

    def __init__(self) -> None:
        self._before: list[Any] | None = None
        with contextlib.suppress(OSError, ValueError, termios.error):
            self._before = termios.tcgetattr(sys.stdin.fileno())

    def restore(self) -> None:
        """Put it back, if it is in another mode now."""
        if self._before is None:
            return
        with contextlib.suppress(OSError, ValueError, termios.error):
            if termios.tcgetattr(sys.stdin.fileno()) != self._before:
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, self._before)
                os.write(sys.stdout.fileno(), _LEAVE)
