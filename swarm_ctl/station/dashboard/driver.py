"""The terminal itself as Textual's driver: a station's stdin may be a control pipe and its stderr a
log file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from textual.drivers.linux_driver import LinuxDriver

if TYPE_CHECKING:
    from textual.app import App

TTY = "/dev/tty"


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
