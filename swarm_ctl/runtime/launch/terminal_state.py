"""The terminal as it was before a child took it over; put back where the child can't do it any
more."""

from __future__ import annotations

import contextlib
import os
import sys
import termios
from typing import Any, Final

_LEAVE: Final = b"".join(
    b"\x1b[" + code
    for code in (
        b"?2004l",
        b"?1000l",
        b"?1003l",
        b"?1015l",
        b"?1006l",
        b"?1004l",
        b"<u",
        b"?7h",
        b"?25h",
        b"?1049l",
        b"0m",
    )
)
"""No pasting, no mouse, no focus reports, plain keys, wrapping, a cursor, the normal screen, plain
colours."""


class Terminal:
    """What stdin's terminal was like when this was made; nothing where stdin is no terminal."""

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
