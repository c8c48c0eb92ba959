"""Where the own vehicle is in the common frame, from what it says of its own frame.

Each vehicle's LOCAL_POSITION_NED counts from its own origin. Where that origin lies is
GPS_GLOBAL_ORIGIN's word; the offset to the mission's origin is constant, so it is worked out once
per origin. Velocities need no origin.

A vehicle holds the velocity that it estimates. Where its position moves otherwise, the estimate is
wrong: a real PX4 in SIH creeps by up to 0.8 m/s for seconds after each hard turn. That difference,
the drift, is observed here; velocities told of the vehicle count it, and setpoints to it are less
by it, so the vehicle's position moves as the law asked.
"""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.core.model.frames import ned_from_geodetic
from swarm_ctl.core.model.plan import Geodetic, Limits, Point
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.vehicle import LocalFix, Vector3, VehicleView

AGREE_M = 5.0
"""GLOBAL_POSITION_INT and the local position may differ by this much [m] horizontally: both come
from one estimator, so more than latency at full speed (5 m/s for 0.5 s) and rounding means that an
origin is wrong."""
DRIFT_MAX_MPS = 1.0
"""More than this is no error of a velocity estimate that flies."""
_OBSERVED_RADPS = 2.0
"""Bandwidth of the observer. In a flight of a PX4, 0.39 m/s of error left 0.26, 0.19,
0.17, 0.15 at 0.7, 1.5, 2, 3 rad/s; higher ones take the noise of positions for drift."""
_DAMPING = 0.8
"""Settles almost without overshoot."""
_GAP_S = 0.25
"""After a gap in the reports that is longer, the observer begins afresh: its steps would no longer
settle."""
_JUMP_M = 1.0
"""A position that is so far from where the last one led was corrected, not flown."""


@row
class OwnFix:
    """The own vehicle in the common frame. `position_ned_m` is carried on to the time it was asked
    for."""

    age_s: float
    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    """Of the position: what the vehicle says of its velocity, and its drift."""
    height_m: float
    """Above the vehicle's own origin; differences of it are what counts."""
    drift_mps: Point = (0.0, 0.0)
    """By how much the position moves faster (north, east) than the vehicle says, at most
    `DRIFT_MAX_MPS`."""


class Navigator:
    """Turns views into fixes; remembers the offset of the vehicle's origin."""

    def __init__(self, origin: Geodetic) -> None:
        self._origin = origin
        self._vehicle_origin: Geodetic | None = None
        self._offset: Vector3 = (0.0, 0.0, 0.0)
        self._drift = DriftObserver()

    def fix(self, view: VehicleView, now: float) -> OwnFix | None:
        """Position at `now`, carried on from the last report at its velocity for at most half a
        second."""
        if view.local is None or view.origin is None:
            return None
        if view.origin != self._vehicle_origin:
            self._vehicle_origin = view.origin
            self._offset = ned_from_geodetic(view.origin, self._origin)
        local = view.local
        drift = self._drift.observe(local)
        age = max(0.0, now - local.time_s)
        ahead = min(age, 0.5)
        (n, e, d), (vn, ve, vd) = local.position_ned_m, local.velocity_ned_mps
        vn, ve, off = vn + drift.real, ve + drift.imag, self._offset
        position = (n + off[0] + vn * ahead, e + off[1] + ve * ahead, d + off[2] + vd * ahead)
        return OwnFix(age, position, (vn, ve, vd), -d, (drift.real, drift.imag))

    def disagreement_m(self, view: VehicleView, fix: OwnFix) -> float:
        """Horizontal distance between the fix and GLOBAL_POSITION_INT [m]; 0 while there is
        none."""
        if view.global_ is None:
            return 0.0
        north, east, _ = ned_from_geodetic(view.global_.position, self._origin)
        return math.hypot(north - fix.position_ned_m[0], east - fix.position_ned_m[1])


class DriftObserver:
    """Luenberger observer of a constant error of the velocity, from positions and velocities of
    one estimator."""

    def __init__(self) -> None:
        self._boot_s = -math.inf
        self._place = 0j
        self._velocity = 0j
        self._drift = 0j

    def observe(self, report: LocalFix) -> complex:
        """The drift [m/s], north + 1j * east, with this report; the same one again changes
        nothing."""
        elapsed = report.boot_s - self._boot_s
        if elapsed == 0.0:
            return self._drift
        (north, east, _), (v_north, v_east, _) = report.position_ned_m, report.velocity_ned_mps
        place, velocity = complex(north, east), complex(v_north, v_east)
        flown = (0.5 * (self._velocity + velocity) + self._drift) * min(elapsed, _GAP_S)
        missed = place - self._place - flown
        if not 0.0 < elapsed <= _GAP_S:
            self._place, self._drift = place, 0j
        elif abs(missed) > _JUMP_M:
            self._place = place
        else:
            step = _OBSERVED_RADPS * elapsed
            self._place += flown + 2.0 * _DAMPING * step * missed
            self._drift += _OBSERVED_RADPS * step * missed
            self._drift *= DRIFT_MAX_MPS / max(DRIFT_MAX_MPS, abs(self._drift))
        self._boot_s, self._velocity = report.boot_s, velocity
        return self._drift


_GAIN: Final = 0.5
"""[1/s]: well under 1 / (dead time + lag) of any multirotor, so the loop cannot ring."""


def climb_rate(height_error_m: float, limits: Limits) -> float:
    """Climb rate [m/s, up] for a height error [m, positive: too low]. 0 for one that is not
    finite."""
    if not math.isfinite(height_error_m):
        return 0.0
    return max(-limits.descent_mps, min(limits.climb_mps, _GAIN * height_error_m))
