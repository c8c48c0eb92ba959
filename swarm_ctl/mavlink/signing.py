"""MAVLink 2 signing of one vehicle's link: signs what goes out, judges what comes in. Pure.

A signature is a link id, a stamp (10 us since 2015) and six bytes of SHA-256 over the key and the
frame. The signature is compared first and the stamp afterwards: pymavlink's own check stores the
stamp before it compares, so that one forged frame would lock the vehicle out.
"""

from __future__ import annotations

import hashlib
import hmac
import math
from collections import Counter
from collections.abc import Callable
from enum import StrEnum
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.errors import LinkError
from swarm_ctl.mavlink.framer import MavlinkFrame

KEY_BYTES: Final = 32
UNITS_S: Final = 100_000
"""Stamps count so many a second."""
SAVE_EVERY: Final = 10 * UNITS_S
_V2, _MAC_BYTES, _SIGNATURE_BYTES = 0xFD, 6, 13
_LAST: Final = 2**48 - 2**40
"""Four months of stamps are left after it, in the year 2104. A sender at the end of the range would
have no stamp for its next frame."""
_SOURCES: Final = 16
"""Senders whose stamps are remembered, as in the autopilots; only holders of the key count."""
_WINDOW_S: Final = 10.0
_RADIO: Final = (dialect.MAVLINK_MSG_ID_RADIO_STATUS, dialect.MAVLINK_MSG_ID_RADIO)
"""A telemetry radio puts these into the stream and has no key. Nothing here reads them: they are
dropped, and are no forgery."""


class SigningRefusal(StrEnum):
    """Why a frame does not count, in the words of the alarm."""

    UNSIGNED = "unsigned"
    MAVLINK_1 = "MAVLink 1"
    WRONG_KEY = "wrongly signed"
    REPLAYED = "replayed"
    """Its stamp is not newer than the last one, or it was signed for another link."""
    AHEAD = "stamped too far ahead"


class LinkSigning:
    """The signing state of one link.

    Args:
        key: the vehicle's 32 bytes; LinkError for another length.
        start: the first stamp; no frame that is older counts. A vehicle raises its own stamps to
            those that it hears, so one with an old clock is heard after our first frame.
        keep: gets the newest stamp each 10 s; it must not block.
        link: the link id that we sign with.
        trouble: why stamps are not kept, or ''.
        pace: how fast stamps go beside the caller's clock, which may be faster than the real one.
    """

    def __init__(
        self,
        key: bytes,
        start: int,
        keep: Callable[[int], None] = lambda _: None,
        link: int = 0,
        trouble: Callable[[], str] = str,
        pace: float = 1.0,
    ) -> None:
        if len(key) != KEY_BYTES:
            raise LinkError(f"a signing key has {len(key)} bytes; allowed: {KEY_BYTES}")
        self._key, self._link, self._keep = key, link, keep
        self.trouble, self._pace = trouble, pace
        self._start = self._stamp = self._kept = start
        self._since: float | None = None
        self._heard: dict[tuple[int, int], tuple[int, int]] = {}
        """Link id and last stamp of each sender (system, component)."""

    def __repr__(self) -> str:
        return f"Signing(link={self._link})"

    def equip(self, codec: Any) -> None:
        """Make a pymavlink codec sign what it packs. It must decode nothing."""
        codec.signing.secret_key, codec.signing.link_id = self._key, self._link
        codec.signing.sign_outgoing = True

    def next_stamp(self, now: float) -> int:
        """The stamp of the next frame; `now` is the caller's clock [s]."""
        if self._since is None:
            self._since = now
        elapsed = math.floor((now - self._since) * UNITS_S * self._pace)
        self._raise_to(max(self._stamp + 1, self._start + elapsed))
        return self._stamp

    def refusal(self, frame: MavlinkFrame) -> SigningRefusal | None:
        """Why a frame does not count; None: it is signed with our key, and new."""
        raw = frame.raw
        if raw[0] != _V2:
            return SigningRefusal.MAVLINK_1
        if not frame.signed:
            return SigningRefusal.UNSIGNED
        mac = hashlib.sha256(self._key + raw[:-_MAC_BYTES]).digest()[:_MAC_BYTES]
        if not hmac.compare_digest(mac, raw[-_MAC_BYTES:]):
            return SigningRefusal.WRONG_KEY
        stamp = int.from_bytes(raw[-12:-_MAC_BYTES], "little")
        return self._untimely((frame.system, frame.component), raw[-_SIGNATURE_BYTES], stamp)

    def _untimely(self, source: tuple[int, int], link: int, stamp: int) -> SigningRefusal | None:
        known, last = self._heard.get(source, (link, self._start - 1))
        if link != known or stamp <= last:
            return SigningRefusal.REPLAYED
        if stamp > _LAST:
            return SigningRefusal.AHEAD
        if source not in self._heard and len(self._heard) >= _SOURCES:
            return SigningRefusal.REPLAYED
        self._heard[source] = link, stamp
        self._raise_to(stamp)
        return None

    def _raise_to(self, stamp: int) -> None:
        self._stamp = max(self._stamp, stamp)
        if self._stamp - self._kept >= SAVE_EVERY:
            self._kept = self._stamp
            self._keep(self._stamp)


class RefusedFrames:
    """Counts the frames that one vehicle's link refused, and says so for as long as they come."""

    def __init__(self, sysid: int) -> None:
        self.total: Counter[SigningRefusal] = Counter()
        self._sysid = sysid
        self._window: Counter[SigningRefusal] = Counter()
        self._since = -math.inf
        self._said = ""

    def note(self, refusal: SigningRefusal, frame: MavlinkFrame, now: float) -> None:
        """One more."""
        if frame.message_id in _RADIO:
            return
        self._turn(now)
        self.total[refusal] += 1
        self._window[refusal] += 1

    def words(self, now: float) -> str:
        """Those of the last full ten seconds, or of the first ones so far; '' where none came."""
        self._turn(now)
        return self._said or (self._told(now - self._since) if self._window else "")

    def _turn(self, now: float) -> None:
        if now - self._since >= _WINDOW_S:
            self._said = self._told(_WINDOW_S) if now - self._since < 2 * _WINDOW_S else ""
            self._window.clear()
            self._since = now

    def _told(self, seconds: float) -> str:
        span = f"in {max(1.0, seconds):.0f} s"
        return "; ".join(
            f"{reason} frames for vehicle {self._sysid} refused: {count} {span}"
            for reason, count in sorted(self._window.items())
        )
