"""What a vehicle's heartbeats prove. One alone may be forged or garbled; several in a row, with
none in between that says otherwise, are the vehicle's own.

A heartbeat has neither a time nor a sender that could be checked. But the vehicle goes on sending
its own, and more when asked: so heartbeats that say other than what is believed (`armed` and the
mode) count only while no heartbeat says what is believed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

ASK_S: Final = 0.2
"""While the heartbeats say other than what is believed, the vehicle is asked for more so often."""
DOUBT_S: Final = 3.0
"""For so long at most, heartbeats that disagree hold commands back."""
FALLS: Final = (1, 0.0)
"""For `disarmed`, where the vehicle's velocity says that it falls."""
EXPECTED: Final = (2, 0.15)
"""Heartbeats in a row, and seconds from the first to the last, for what the goal asks for, and for
`disarmed` on the ground."""
AGREED: Final = (3, 1.2)
"""For anything else, where the vehicle's other messages go on with its clock. A vehicle sends a
heartbeat each second, so one of its own falls into 1.2 s even where it answers no request."""
ALONE: Final = (3, 3.0)
"""For anything else, where nothing but heartbeats is heard."""


class FlightState(NamedTuple):
    """What a HEARTBEAT says of the flight."""

    armed: bool
    custom_mode: int | None


_UNKNOWN: Final = FlightState(armed=False, custom_mode=None)


class OtherMessages(NamedTuple):
    """What the vehicle's other messages say when a heartbeat comes."""

    boot_s: float
    """The vehicle's own clock."""
    down: bool
    """It stands on the ground."""
    falls: bool
    """It goes down faster than any vehicle flies."""


class _Row(NamedTuple):
    """Heartbeats in a row that say other than what is believed."""

    heard: int
    first_s: float
    boot_s: float
    """The vehicle's own clock at the first of them."""


def _nothing(_: FlightState) -> bool:
    return False


@dataclass(slots=True)
class HeartbeatEvidence:
    """Judges each heartbeat by those before it."""

    expects: Callable[[FlightState], bool] = _nothing
    """Is this what the goal asks of the vehicle?"""
    refuted: int = 0
    """Rows that ended with a heartbeat that says what was believed."""
    told: FlightState = _UNKNOWN
    """What the newest heartbeat of the newest row said."""
    _row: _Row | None = None

    @property
    def doubt(self) -> bool:
        """The newest heartbeat says other than what is believed."""
        return self._row is not None

    def proves(
        self, told: FlightState, believed: FlightState, now: float, others: OtherMessages
    ) -> bool:
        """Whether what this heartbeat tells is to be believed from now on."""
        if told == believed:
            self.refuted += self._row is not None
            self._row = None
            return False
        self.told = told
        row = self._row or _Row(0, now, others.boot_s)
        self._row = row = row._replace(heard=row.heard + 1)
        count, seconds = self._needed(told, now - row.first_s, others, row.boot_s)
        if believed.armed and (row.heard < count or now - row.first_s < seconds):
            return False
        self._row = None
        return True

    def _needed(
        self, told: FlightState, heard_s: float, others: OtherMessages, first_boot_s: float
    ) -> tuple[int, float]:
        if others.falls and not told.armed:
            return FALLS
        if self.expects(told) or (others.down and not told.armed):
            return EXPECTED
        return AGREED if others.boot_s - first_boot_s >= 0.5 * heard_s else ALONE
