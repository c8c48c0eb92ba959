"""The numbers of a flight, from the truth. Pure: arrays in, numbers out.

T moments, n agents in the plan's order; points are horizontal (north, east) in metres, times in
mission seconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.law.formation import errors
from swarm_ctl.report.folder.truth import Bools, Floats, Truth

_CLOCK_S = 1e-6
"""Two times this close are one moment: truth times are written with six decimals."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueFlight:
    """The truth, seen from the plan: one column per agent."""

    time_s: Floats
    """(T,)"""
    points_m: Floats
    """(T, n, 2); nan for an agent whose vehicle the truth does not have."""
    live: Bools
    """(T, n): airborne, and its agent not yet lost."""

    def during(self, start_s: float, end_s: float) -> TrueFlight:
        """The part from `start_s` to `end_s`, both included."""
        inside = (self.time_s >= start_s - _CLOCK_S) & (self.time_s <= end_s + _CLOCK_S)
        return replace(
            self, time_s=self.time_s[inside], points_m=self.points_m[inside], live=self.live[inside]
        )


def flight_of(truth: Truth, sysids: Sequence[int], live_until_s: npt.ArrayLike) -> TrueFlight:
    """The flight of the agents whose vehicles are `sysids`, each live until its `live_until_s` (n,)
    at most."""
    column = {sysid: k for k, sysid in enumerate(truth.sysids)}
    points = np.full((len(truth.time_s), len(sysids), 2), np.nan)
    airborne = np.zeros(points.shape[:2], dtype=np.bool_)
    for k, sysid in enumerate(sysids):
        if sysid in column:
            points[:, k] = truth.position_ned_m[:, column[sysid], :2]
            airborne[:, k] = truth.airborne[:, column[sysid]]
    return TrueFlight(
        truth.time_s, points, airborne & (truth.time_s[:, None] <= np.asarray(live_until_s))
    )


def formation_error(flight: TrueFlight, slots_m: npt.ArrayLike) -> Floats:
    """Largest |e_i - mean e| of the live agents at each moment [m], (T,); nan without live agents.

    `slots_m` is (n, 2), or (T, n, 2) where they change.
    """
    live = flight.live[..., None]
    e = np.where(live, errors(flight.points_m, slots_m), 0.0)
    count = flight.live.sum(axis=1)
    mean = e.sum(axis=1) / np.maximum(count, 1)[:, None]
    deviation = np.where(flight.live, np.linalg.norm(e - mean[:, None], axis=-1), 0.0)
    return np.where(count > 0, deviation.max(axis=1, initial=0.0), np.nan)


def time_to_settle(
    time_s: Floats,
    error_m: Floats,
    start_s: float,
    end_s: float,
    tolerance_m: float,
    settle_s: float,
) -> float | None:
    """Seconds from `start_s` until the error begins to stay below `tolerance_m` for `settle_s`.

    It has to begin by `end_s`; None if it does not. `error_m` is (T,), nan is not below.
    """
    # The runs of consecutive samples below the tolerance: from `begins` to `ends`, both included.
    chosen = time_s >= start_s - _CLOCK_S
    time_s, under = time_s[chosen], (error_m < tolerance_m)[chosen]
    edges = np.diff(np.concatenate(([0], under.astype(np.int8), [0])))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    long_enough = (time_s[ends] - time_s[begins] >= settle_s - _CLOCK_S) & (
        time_s[begins] <= end_s + _CLOCK_S
    )
    found = begins[long_enough]
    return max(0.0, float(time_s[found[0]]) - start_s) if len(found) else None


def longest_link(
    flight: TrueFlight, links: Iterable[tuple[int, int]]
) -> tuple[float, tuple[int, int]] | None:
    """The greatest length [m] of any of the `links` (pairs of columns) while both agents were live,
    and that link."""
    found: list[tuple[float, tuple[int, int]]] = []
    for i, j in links:
        both = flight.live[:, i] & flight.live[:, j]
        if both.any():
            lengths = np.linalg.norm(flight.points_m[both, i] - flight.points_m[both, j], axis=-1)
            found.append((float(lengths.max()), (i, j)))
    return max(found, default=None)


def closest_approach(truth: Truth) -> tuple[float, tuple[int, int]] | None:
    """The smallest true horizontal distance [m] and its pair of sysids; None without a flight."""
    return min(((distance, pair) for pair, distance in truth.minima.items()), default=None)


def last_number(values: Floats) -> float | None:
    """The last of `values` (T,) that is finite, or None."""
    numbers = values[np.isfinite(values)]
    return float(numbers[-1]) if len(numbers) else None
