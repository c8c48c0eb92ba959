"""The terminal itself as Textual's driver: a station's stdin may be a control pipe and its stderr a
log file."""

from __future__ import annotations

import os
from collections.abc import Callable
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
        self._keys = os.open(TTY, os.O_RDONLY | os.O_NOCTTY)
        self._silence = os.pipe()
        self._screen = _Screen(self._hung_up)
        self._file = self._screen  # type: ignore[assignment]
        self.fileno = self._keys
        self.input_tty = True

    def _hung_up(self) -> None:
        """The terminal was closed: no key comes any more. Such a terminal is always readable, so
        the thread that reads keys may be between its look and its read: the byte is what it gets,
        or it would wait for ever, and the station for it."""
        os.write(self._silence[1], b"\0")
        os.dup2(self._silence[0], self._keys)

    def _sigcont_application(self, *_: object) -> None:
        """Begin anew. The kernel says this beside a hang-up, too, when nothing was suspended: a
        second thread would read keys beside the first."""
        self.disable_input()
        super()._sigcont_application()

    def close(self) -> None:
        """Give the terminal back."""
        super().close()
        self._screen.close()
        for descriptor in (self._keys, *self._silence):
            os.close(descriptor)


class _Screen:
    """The terminal to draw on. Once it was closed, all that is drawn goes nowhere: a station works
    on without a screen."""

    def __init__(self, hung_up: Callable[[], None]) -> None:
        self._descriptor = os.open(TTY, os.O_WRONLY | os.O_NOCTTY)
        self._tell: Callable[[], None] | None = hung_up

    def write(self, text: str) -> None:
        data = text.encode()
        try:
            while data and self._tell is not None:
                data = data[os.write(self._descriptor, data) :]
        except OSError:
            tell, self._tell = self._tell, None
            if tell is not None:
                tell()

    def flush(self) -> None:
        """All is written already."""

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return True

    def close(self) -> None:
        os.close(self._descriptor)
