"""How much of a shared radio each vehicle uses."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

_WINDOW_S: Final = 1.0


class Flow:
    """Frames and bytes of the last second."""

    def __init__(self) -> None:
        self._sizes: deque[tuple[float, int]] = deque()
        self._bytes = 0

    def add(self, size: int, now: float) -> None:
        """A frame of `size` bytes has passed."""
        self._sizes.append((now, size))
        self._bytes += size

    def per_s(self, now: float) -> tuple[int, int]:
        """Frames and bytes a second."""
        while self._sizes and self._sizes[0][0] <= now - _WINDOW_S:
            self._bytes -= self._sizes.popleft()[1]
        return len(self._sizes), self._bytes


@dataclass(frozen=True, slots=True)
class VehicleLoad:
    """One vehicle's part of the radio."""

    agent: int
    sysid: int
    up_frames_per_s: int
    down_frames_per_s: int
    setpoints_per_s: int
    bytes_per_s: int
    """Both directions."""
    thinned: int
    """Frames up that a newer one replaced, since the start."""
    dropped: int
    """Frames up for which there was no room, since the start."""
    late: int
    """Positions that came too late to be passed on, since the start."""
    age_s: float | None
    """Of the newest frame of the vehicle; None: none came yet."""


@dataclass(frozen=True, slots=True)
class RadioLoad:
    """A shared radio."""

    radio: str
    bytes_per_s: int
    """What it carries."""
    used_bytes_per_s: int
    foreign: int
    """Frames of systems that are none of the fleet's, since the start."""
    bad: int
    """Runs of bytes that were no frame."""
    trouble: str
    """Why the radio can't be used now, or ''."""
    vehicles: tuple[VehicleLoad, ...] = field(default=())
