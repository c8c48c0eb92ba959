"""How close each pair of agents' vehicles came, and who says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from swarm_ctl.report.folder.flight import TrackSource
from swarm_ctl.report.folder.metrics import Approach, approaches
from swarm_ctl.report.folder.run_folder import RunFolder

_STRAIGHT_M: Final = 0.05
"""The simulator knows its vehicles' ways between two lines of truth, which are not straight: at
10 m/s2 they bend by 2.5 cm. A shorter straight way than its own distance counts from here on."""


@dataclass(frozen=True, slots=True)
class PairDistance:
    """One pair at its closest."""

    agents: tuple[int, int]
    """The lower id first."""
    distance_m: float
    """Horizontal."""
    time_s: float
    doubt_m: float
    source: TrackSource


def pair_distances(run: RunFolder) -> list[PairDistance]:
    """Each pair of which something is known, the closest first."""
    if run.flight is None or run.plan is None:
        return []
    found = (_pair(run, approach) for approach in approaches(run.flight))
    return sorted(found, key=lambda pair: pair.distance_m)


def _pair(run: RunFolder, found: Approach) -> PairDistance:
    a, b = sorted(run.agents[k] for k in found.columns)
    sources = {run.flight.sources[k] for k in found.columns} if run.flight else set()
    if TrackSource.ESTIMATES in sources:
        return PairDistance(
            (a, b), found.distance_m, found.time_s, found.doubt_m, TrackSource.ESTIMATES
        )
    distance_m, time_s = found.distance_m, found.time_s
    if run.truth is not None and run.manifest is not None:
        sysid = {entry.id: entry.sysid for entry in run.manifest.fleet}
        pair = (min(sysid[a], sysid[b]), max(sysid[a], sysid[b]))
        told_m = run.truth.minima.get(pair)
        if told_m is not None and distance_m > told_m - _STRAIGHT_M:
            distance_m, time_s = told_m, run.truth.minima_s[pair]
    return PairDistance((a, b), distance_m, time_s, 0.0, TrackSource.TRUTH)
