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
_BEHIND_10US = 60 * 100_000
"""A sender not heard before may be this far behind our own timestamp."""


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
        raise ValueError(f"not a signing key: {allowed}")
    return key


class Signing:
    """Signs what one link sends, and judges what it receives.

    Timestamps count 10 us since 2015 and must rise, per sender and link, so that a recorded frame
    is refused the second time.
    """

    def __init__(self, key: bytes, now_10us: Callable[[], int], link: int = 0) -> None:
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._now_10us = now_10us
        self._link = link
        self._last = 0
        self._heard: dict[tuple[int, int, int], int] = {}

    def __repr__(self) -> str:
        return f"Signing(link={self._link})"

    def sign(self, frame: bytes) -> bytes:
        """The signature to append to `frame` (header to checksum, its signed flag set)."""
        self._last = max(self._last + 1, self._now_10us())
        mark = bytes([self._link]) + self._last.to_bytes(6, "little")
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
        last = self._heard.get(sender)
        if last is None:
            last = max(self._last, self._now_10us()) - _BEHIND_10US - 1
        if at <= last:
            return False
        self._heard[sender] = at
        return True

    def _hash(self, data: bytes) -> bytes:
        return hashlib.sha256(self._key + data).digest()[:6]
