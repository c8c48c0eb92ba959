"""How close each pair of agents' vehicles came, and each vehicle to zones, and who says so."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from swarm_ctl.runfolder.flight import TrackSource
from swarm_ctl.runfolder.metrics import Approach, approaches, zone_distance
from swarm_ctl.runfolder.run_folder import RunFolder, ZoneSpell

_STRAIGHT_M: Final = 0.05
"""The simulator knows its vehicles' ways between two lines of truth, which are not straight: at
10 m/s2 they bend by 2.5 cm. A shorter straight way than its own distance counts from here on."""


@dataclass(frozen=True, slots=True)
class PairDistance:
    """One pair at its closest."""

    agents: tuple[int, int]
    """The lower id first."""
    distance_m: float
    """Horizontal; of a mission with heights, while they were not `layer_m` apart in height."""
    time_s: float
    doubt_m: float
    source: TrackSource


def pair_distances(run: RunFolder) -> list[PairDistance]:
    """Each pair of which something is known, the closest first."""
    if run.flight is None or run.plan is None:
        return []
    found = (_pair(run, approach) for approach in approaches(run.flight, run.plan.layer_m))
    return sorted(found, key=lambda pair: pair.distance_m)


def _pair(run: RunFolder, found: Approach) -> PairDistance:
    a, b = sorted(run.agents[k] for k in found.columns)
    sources = {run.flight.sources[k] for k in found.columns} if run.flight else set()
    if TrackSource.ESTIMATES in sources:
        return PairDistance(
            (a, b), found.distance_m, found.time_s, found.doubt_m, TrackSource.ESTIMATES
        )
    distance_m, time_s = found.distance_m, found.time_s
    level = run.plan is not None and run.plan.wake is None
    if run.truth is not None and run.manifest is not None and level:  # those know no layers
        sysid = {entry.id: entry.sysid for entry in run.manifest.fleet}
        pair = (min(sysid[a], sysid[b]), max(sysid[a], sysid[b]))
        told_m = run.truth.minima.get(pair)
        if told_m is not None and distance_m > told_m - _STRAIGHT_M:
            distance_m, time_s = told_m, run.truth.minima_s[pair]
    return PairDistance((a, b), distance_m, time_s, 0.0, TrackSource.TRUTH)


@dataclass(frozen=True, slots=True)
class ZoneDistance:
    """One vehicle in the air at its closest to one zone, at the zone's heights."""

    agent: int
    zone: str
    distance_m: float
    """Horizontal, at the moments that are known; 0: it was in it."""
    time_s: float
    """The first moment of all at this distance."""
    point_ned_m: tuple[float, float, float]
    source: TrackSource


def zone_distances(run: RunFolder) -> list[ZoneDistance]:
    """Each agent that was at the heights of a zone while this was in force, the closest first. One
    that was in it when it came counts once it has left."""
    found = (
        _to_zone(run, k, agent, spell) for spell in run.zones for k, agent in enumerate(run.agents)
    )
    return sorted((each for one in found for each in one), key=lambda each: each.distance_m)


def _to_zone(run: RunFolder, k: int, agent: int, spell: ZoneSpell) -> Iterator[ZoneDistance]:
    flight, zone = run.flight, spell.zone
    if flight is None:
        return
    time_s, high_m = flight.time_s, -flight.position_ned_m[:, k, 2]
    low = -math.inf if zone.floor_m is None else zone.floor_m
    high = math.inf if zone.ceiling_m is None else zone.ceiling_m
    counts = flight.airborne[:, k] & (time_s >= spell.from_s) & (time_s < spell.until_s)
    counts &= (high_m >= low) & (high_m <= high) & np.isfinite(flight.points_m[:, k, 0])
    away = np.full(len(time_s), np.inf)
    away[counts] = zone_distance(flight.points_m[counts, k], zone)
    if math.isfinite(spell.from_s):
        since = int(np.searchsorted(time_s, spell.from_s))
        out = np.flatnonzero(away[since:] > 0.0)
        away[: since + int(out[0]) if len(out) else None] = np.inf
    at = int(away.argmin()) if len(away) else 0
    if len(away) and math.isfinite(away[at]):
        n, e, d = flight.position_ned_m[at, k].tolist()
        told = flight.sources[k]
        yield ZoneDistance(agent, zone.name, float(away[at]), float(time_s[at]), (n, e, d), told)
