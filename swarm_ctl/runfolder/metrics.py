"""The numbers of a flight. Pure: arrays in, numbers out.

T moments, n agents in the plan's order; points are horizontal (north, east) in metres, times in
mission seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.law.formation import errors
from swarm_ctl.core.model.vehicle import OVER_M
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.runfolder.flight import CLOCK_S, Flight, TrackSource
from swarm_ctl.runfolder.truth import Floats


@dataclass(frozen=True, slots=True)
class Approach:
    """The closest that two vehicles came, horizontally."""

    columns: tuple[int, int]
    distance_m: float
    time_s: float
    doubt_m: float
    """How far the distance may be off; 0 by the truth."""


def approaches(flight: Flight, layer_m: float = math.inf) -> Iterator[Approach]:
    """Each pair at its closest, also between two moments: both on straight lines. Moments at whose
    begin and end the two are `layer_m` apart in height, or more, do not count.

    By the truth while any vehicle is in the air, but for one that flies over one on the ground
    (`OVER_M`). By an estimate while both are: on the ground the
    noise of a position is no approach.
    """
    true = np.array([source is TrackSource.TRUTH for source in flight.sources])
    flying, some = flight.airborne, flight.airborne.any(axis=1, keepdims=True)
    for i in range(len(true) - 1 if len(flight.time_s) > 1 else 0):
        others = slice(i + 1, None)
        apart = flight.points_m[:, others] - flight.points_m[:, i : i + 1]
        counts = np.where(true[i] & true[others], some, flying[:, i : i + 1] & flying[:, others])
        down = flight.position_ned_m[..., 2]
        high = np.abs(down[:, others] - down[:, i : i + 1])
        higher = high > OVER_M
        counts = counts & ~(higher & (flying[:, others] != flying[:, i : i + 1]))
        counts = counts & ~(high >= layer_m)
        start, way = apart[:-1], np.diff(apart, axis=0)
        square = np.maximum((way * way).sum(axis=-1), 1e-12)
        share = np.clip(-(start * way).sum(axis=-1) / square, 0.0, 1.0)
        near = np.linalg.norm(start + share[..., None] * way, axis=-1)
        near[~(counts[:-1] | counts[1:]) | np.isnan(near)] = np.inf
        for m, k in enumerate(near.argmin(axis=0).tolist()):
            if np.isfinite(near[k, m]):
                j = i + 1 + m
                time_s = flight.time_s[k] + share[k, m] * (flight.time_s[k + 1] - flight.time_s[k])
                doubt_m = flight.doubt_m[k : k + 2, [i, j]].max(axis=0).sum()
                yield Approach((i, j), float(near[k, m]), float(time_s), float(doubt_m))


def zone_distance(points_m: Floats, zone: Zone) -> Floats:
    """How far each of the points (T, 2) is from a zone, horizontally [m], (T,); 0 in it, nan where
    the point is not known."""
    corners = np.array(zone.corners_m)
    if len(corners) == 1:
        away = np.linalg.norm(points_m - corners[0], axis=-1)
        return np.asarray(np.maximum(away - zone.radius_m, 0.0))
    found = np.full(len(points_m), np.inf)
    inside = np.zeros(len(points_m), dtype=np.bool_)
    north, east = points_m.T
    for (a_n, a_e), (b_n, b_e) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way_n, way_e = b_n - a_n, b_e - a_e
        square = max(way_n * way_n + way_e * way_e, 1e-12)
        share = np.clip(((north - a_n) * way_n + (east - a_e) * way_e) / square, 0.0, 1.0)
        away = np.hypot(north - a_n - share * way_n, east - a_e - share * way_e)
        found = np.minimum(found, away)
        if way_e:
            # multiplied, not divided: an edge may run east by next to nothing
            beyond = ((north - a_n) * way_e < (east - a_e) * way_n) == (way_e > 0.0)
            inside ^= ((a_e > east) != (b_e > east)) & beyond
    found[inside] = 0.0
    return found


def formation_error(flight: Flight, slots_m: npt.ArrayLike) -> Floats:
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
    chosen = time_s >= start_s - CLOCK_S
    time_s, under = time_s[chosen], (error_m < tolerance_m)[chosen]
    edges = np.diff(np.concatenate(([0], under.astype(np.int8), [0])))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    long_enough = (time_s[ends] - time_s[begins] >= settle_s - CLOCK_S) & (
        time_s[begins] <= end_s + CLOCK_S
    )
    found = begins[long_enough]
    return max(0.0, float(time_s[found[0]]) - start_s) if len(found) else None


def longest_link(
    flight: Flight, links: Iterable[tuple[int, int]]
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


def last_number(values: Floats) -> float | None:
    """The last of `values` (T,) that is finite, or None."""
    numbers = values[np.isfinite(values)]
    return float(numbers[-1]) if len(numbers) else None
