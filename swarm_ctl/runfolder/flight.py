"""Where the vehicles were, a column per agent: by the simulator's truth where it has the vehicle,
else by what the vehicle told of itself. Pure.

T moments, n agents in the plan's order; NED in metres in the mission's frame, times in mission
seconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from swarm_ctl.runfolder.tracks import Track
from swarm_ctl.runfolder.truth import Bools, Floats, Truth

CLOCK_S: Final = 1e-6
"""Two times this close are one moment: truth times are written with six decimals."""
_GRID_S: Final = 0.1
"""Between the moments of a flight without truth: as the truth is written."""


class TrackSource(StrEnum):
    """Who says where a vehicle was."""

    TRUTH = "truth"
    """The simulator."""
    ESTIMATES = "estimates"
    """The vehicle itself, as its agent told the mesh."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """The whole flight, one column per agent."""

    time_s: Floats
    """(T,)"""
    position_ned_m: Floats
    """(T, n, 3); nan where it is not known."""
    descent_mps: Floats
    """(T, n)"""
    armed: Bools
    """(T, n)"""
    airborne: Bools
    """(T, n)"""
    live: Bools
    """(T, n): airborne, its place known, and its agent not yet lost."""
    doubt_m: Floats
    """(T, n): how far from there it may have been, horizontally; 0 for the truth."""
    sources: tuple[TrackSource, ...]
    """(n,)"""

    @property
    def points_m(self) -> Floats:
        """(T, n, 2), horizontal."""
        return self.position_ned_m[..., :2]

    def during(self, start_s: float, end_s: float) -> Flight:
        """The part from `start_s` to `end_s`, both included."""
        inside = (self.time_s >= start_s - CLOCK_S) & (self.time_s <= end_s + CLOCK_S)
        names = ("time_s", "position_ned_m", "descent_mps", "armed", "airborne", "live", "doubt_m")
        return replace(self, **{name: getattr(self, name)[inside] for name in names})

    def of(self, columns: list[int]) -> Flight:
        """Of these agents alone."""
        names = ("position_ned_m", "descent_mps", "armed", "airborne", "live", "doubt_m")
        chosen = {name: getattr(self, name)[:, columns] for name in names}
        return replace(self, **chosen, sources=tuple(self.sources[k] for k in columns))


def no_flight(agents: int) -> Flight:
    """Of a run of which nothing is known."""
    none = np.zeros((0, agents))
    flags = none.astype(np.bool_)
    sources = (TrackSource.ESTIMATES,) * agents
    return Flight(
        time_s=np.zeros(0),
        position_ned_m=np.zeros((0, agents, 3)),
        descent_mps=none,
        armed=flags,
        airborne=flags,
        live=flags,
        doubt_m=none,
        sources=sources,
    )


def flight_of(
    truth: Truth | None,
    sysids: Sequence[int],
    live_until_s: npt.ArrayLike,
    tracks: Mapping[int, Track] | None = None,
) -> Flight:
    """The flight of the agents whose vehicles are `sysids`, each live until its `live_until_s` (n,)
    at most. `tracks` (by place) stand for the vehicles that the truth does not have."""
    tracks = tracks or {}
    time_s = truth.time_s if truth is not None and len(truth.time_s) else _grid(tracks.values())
    n, known = len(sysids), {sysid: k for k, sysid in enumerate(truth.sysids)} if truth else {}
    position = np.full((len(time_s), n, 3), np.nan)
    descent, doubt = np.full((len(time_s), n), np.nan), np.zeros((len(time_s), n))
    armed = np.zeros((len(time_s), n), dtype=np.bool_)
    airborne = armed.copy()
    for k, sysid in enumerate(sysids):
        if truth is not None and sysid in known and len(truth.time_s):
            of = known[sysid]
            position[:, k], descent[:, k] = truth.position_ned_m[:, of], truth.descent_mps[:, of]
            armed[:, k], airborne[:, k] = truth.armed[:, of], truth.airborne[:, of]
        elif k in tracks:
            position[:, k], descent[:, k], doubt[:, k] = tracks[k].motion(time_s)
            armed[:, k], airborne[:, k] = tracks[k].arming(time_s)
    there = np.isfinite(position[..., 0])
    live = airborne & there & (time_s[:, None] <= np.asarray(live_until_s))
    sources = [TrackSource.TRUTH if sysid in known else TrackSource.ESTIMATES for sysid in sysids]
    return Flight(
        time_s=time_s,
        position_ned_m=position,
        descent_mps=descent,
        armed=armed,
        airborne=airborne,
        live=live,
        doubt_m=doubt,
        sources=tuple(sources),
    )


def _grid(tracks: Iterable[Track]) -> Floats:
    spans = [(t.time_s[0], t.time_s[-1]) for t in tracks if len(t.time_s)]
    if not spans:
        return np.zeros(0)
    first, last = min(span[0] for span in spans), max(span[1] for span in spans)
    return np.asarray(np.arange(first, last + _GRID_S, _GRID_S))
