"""The terminal itself as Textual's driver: a station's stdin may be a control pipe and its stderr a
log file."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from textual.drivers.linux_driver import LinuxDriver

if TYPE_CHECKING:
    from textual.app import App

TTY = "/dev/tty"


def in_front() -> bool:
    """Whether there is a terminal that shows our stdout and would give us its keys now."""
    if not sys.stdout.isatty():
        return False
    try:
        descriptor = os.open(TTY, os.O_RDWR | os.O_NOCTTY)
    except OSError:
        return False
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return False
    finally:
        os.close(descriptor)


class TtyDriver(LinuxDriver):
    """Reads keys from the controlling terminal and draws on it, whatever stdin and stderr are."""

    def __init__(
        self,
        app: App[object],
        *,
        debug: bool = False,
        mouse: bool = True,
        size: tuple[int, int] | None = None,
    ) -> None:
        super().__init__(app, debug=debug, mouse=mouse, size=size)
        self._file = self._screen = open(TTY, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - closed in `close`
        self._keys = os.open(TTY, os.O_RDONLY | os.O_NOCTTY)
        self.fileno = self._keys
        self.input_tty = True

    def close(self) -> None:
        """Give the terminal back."""
        super().close()
        self._screen.close()
        os.close(self._keys)
