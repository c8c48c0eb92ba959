"""MAVLink 2 signing: only clients with the key may speak to a vehicle.

The key is never shown or logged.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from pathlib import Path

KEY_BYTES = 32
SIGNATURE_BYTES = 13
"""Link id, timestamp (6 bytes), and the first 6 bytes of the hash."""
_LAST_10US = 2**48 - 2**40
"""Four months of timestamps are left after it; a sender at the end of the range could not go on."""
_SENDERS = 16
"""Remembered at most, as in the real firmwares; only those with the key count."""


def read_key(path: Path) -> bytes:
    """The key in a file of 32 bytes, or of 64 hexadecimal digits; otherwise ValueError, which
    doesn't show the content."""
    data = path.read_bytes()
    if len(data) == KEY_BYTES:
        return data
    try:
        key = bytes.fromhex(data.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        allowed = f"{KEY_BYTES} bytes or {2 * KEY_BYTES} hexadecimal digits are allowed"
        raise ValueError(f"{path}: not a signing key: {allowed}")
    return key


class VehicleSigning:
    """Signs what one vehicle sends, and judges what it receives, on all its links together.

    Timestamps count 10 us since 2015 and must rise, per sender and its link, so that a recorded
    frame is refused the second time, on other links of the vehicle, too. Own ones follow those that
    are heard. A sender not heard before must not be older than the vehicle's start, or the key's.
    """

    def __init__(self, key: bytes | None, now_10us: Callable[[], int]) -> None:
        self._now_10us = now_10us
        self._key: bytes | None = None
        self._last = self._start = 0
        self._heard: dict[tuple[int, int, int], int] = {}
        if key is not None:
            self.set_up(key, now_10us())

    def __repr__(self) -> str:
        return f"Signing(active={self.active})"

    @property
    def active(self) -> bool:
        """There is a key."""
        return self._key is not None

    def set_up(self, key: bytes, stamp_10us: int) -> None:
        """SETUP_SIGNING: this key from now on; none where key and timestamp are zero."""
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key if stamp_10us or any(key) else None
        self._last = self._start = min(max(self._last, stamp_10us), _LAST_10US)

    def sign(self, frame: bytes, link: int) -> bytes:
        """The signature to append to `frame` (header to checksum, its signed flag set)."""
        self._last = max(self._last + 1, self._now_10us())
        mark = bytes([link]) + self._last.to_bytes(6, "little")
        return mark + self._hash(frame + mark)

    def accepts(self, frame: bytes, source: tuple[int, int]) -> bool:
        """Whether a good frame (with its signature) is signed with our key, and new."""
        if frame[0] != 0xFD or not frame[2] & 1:
            return False
        signed, claimed = frame[:-6], frame[-6:]
        if not hmac.compare_digest(self._hash(signed), claimed):
            return False
        at = int.from_bytes(frame[-12:-6], "little")
        sender = (frame[-13], *source)
        if at <= self._heard.get(sender, self._start - 1) or at > _LAST_10US:
            return False
        if sender not in self._heard and len(self._heard) >= _SENDERS:
            return False
        self._heard[sender] = at
        self._last = max(self._last, at)
        return True

    def _hash(self, data: bytes) -> bytes:
        return hashlib.sha256((self._key or b"") + data).digest()[:6]
