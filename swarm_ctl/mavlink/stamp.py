"""The newest signing stamp of a vehicle's link, on disk: an agent that starts again signs on above
it, and no frame that was recorded before counts.

Written by an agent, so nothing here may hold up a control loop: a thread takes stamps to the disk.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import threading
from pathlib import Path
from typing import Final

from swarm_ctl.mavlink.signing import UNITS_S

_AHEAD: Final = 60 * UNITS_S
"""More than passes between two saves."""
_DIGITS: Final = 15
_YEAR_2015_S: Final = 1_420_070_400


def stamp_at(unix_s: float) -> int:
    """The stamp of a time."""
    return max(0, int((unix_s - _YEAR_2015_S) * UNITS_S))


class StampKeeper:
    """Keeps stamps in the file `path`. `start` is the first stamp to use: the clock's, and at least
    60 s more than the file says."""

    def __init__(self, path: Path, unix_s: float) -> None:
        self.failure = ""
        """Why the file does not protect from replays, or ''."""
        self._path = path
        self.start = max(stamp_at(unix_s), self._read() + _AHEAD)
        self._newest = self.start
        self._wake, self._ended = threading.Event(), False
        self._save()
        self._thread = threading.Thread(target=self._work, name="stamp", daemon=True)
        self._thread.start()

    def keep(self, stamp: int) -> None:
        """Take `stamp` to the disk, soon; never waits."""
        self._newest = stamp
        self._wake.set()

    def close(self, patience_wall_s: float = 2.0) -> None:
        """Write what waits; a disk that does not answer is given up."""
        self._ended = True
        self._wake.set()
        self._thread.join(patience_wall_s)

    def _work(self) -> None:
        while not self._ended:
            self._wake.wait()
            self._wake.clear()
            self._save()

    def _read(self) -> int:
        """A damaged file counts as none: an agent that starts again in the air must fly on, and the
        clock protects from replays as well."""
        try:
            text = self._path.read_text(encoding="ascii").strip()
        except FileNotFoundError:
            return 0
        except (OSError, UnicodeDecodeError) as error:
            self._fail(error)
            return 0
        if text and not (text.isdecimal() and len(text) <= _DIGITS):
            self._fail("it has no stamp")
        return int(text) if text.isdecimal() and len(text) <= _DIGITS else 0

    def _save(self) -> None:
        try:
            with tempfile.NamedTemporaryFile(
                dir=self._path.parent, prefix=".stamp.", delete=False
            ) as file:
                try:
                    file.write(str(self._newest).encode())
                    file.flush()
                    os.fsync(file.fileno())
                    Path(file.name).replace(self._path)
                except OSError:
                    with contextlib.suppress(OSError):
                        Path(file.name).unlink()
                    raise
        except OSError as error:
            self._fail(error)

    def _fail(self, why: object) -> None:
        words = getattr(why, "strerror", None) or why
        self.failure = f"{self._path}: {words}; until it is, only the clock protects from replays"
