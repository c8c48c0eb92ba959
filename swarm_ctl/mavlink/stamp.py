"""The newest signing stamp of a vehicle's link, on disk: an agent that starts again signs on above
it, and no frame that was recorded before counts.

Written by an agent, so nothing here may hold up a control loop: a thread takes stamps to the disk.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

from swarm_ctl.errors import TrustError
from swarm_ctl.mavlink.signing import KEY_BYTES, UNITS_S, LinkSigning
from swarm_ctl.trust.files import read_guarded, write_private

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
            write_private(self._path, str(self._newest).encode())
        except OSError as error:
            self._fail(error)

    def _fail(self, why: object) -> None:
        words = getattr(why, "strerror", None) or why
        self.failure = f"{self._path}: {words}; only this computer's clock protects from replays"


@contextmanager
def kept_signing(
    key: Path, stamp: Path, unix_s: float, link: int = 0, pace: float = 1.0
) -> Iterator[LinkSigning]:
    """Signing with the key in one file and the newest stamp in another, at a time of the system's
    clock. TrustError where the key can't be used, or others may read it."""
    with closing(StampKeeper(stamp, unix_s)) as keeper:
        start, keep = keeper.start, keeper.keep
        yield LinkSigning(read_key(key), start, keep, link, lambda: keeper.failure, pace)


def read_key(path: Path) -> bytes:
    """A key file's 32 bytes; TrustError where it has others, or others may read it."""
    key = read_guarded(path)
    if len(key) != KEY_BYTES:
        raise TrustError(f"{path}: has {len(key)} bytes; allowed: {KEY_BYTES}, a signing key")
    return key
