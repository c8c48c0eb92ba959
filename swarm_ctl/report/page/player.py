"""The player of a page: one flight, or several over one another, on canvas.

`assets/player.js` draws what this module writes. Nothing of the run becomes markup or program: the
page carries it as JSON, and its content security policy lets the player's own script run alone.
What it shares with a page that follows a flight is in `player_parts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.plan import EVERYONE
from swarm_ctl.core.model.text import printable
from swarm_ctl.report.page.player_parts import curves, drawn_zone, flown_moments, labels, markup
from swarm_ctl.report.page.run_history import RunHistory, least
from swarm_ctl.runfolder.flight import Flight
from swarm_ctl.station.picture.colours import inks
from swarm_ctl.station.picture.journal import JournalLine

OFF_M: Final = 0.05
"""What is drawn between the moments that the page keeps may be off by this much."""
_STRIDES: Final = (10, 5, 3, 2)
_MOST: Final = 200_000
"""Moments times agents that a page keeps at most: 11 bytes each."""


@dataclass(frozen=True, slots=True)
class _Kept:
    """The moments of a flight that the page has, and how far off a straight line between them
    is."""

    moments: NDArray[np.intp]
    off_m: float


def player(runs: Sequence[tuple[RunHistory, Iterable[JournalLine]]]) -> str:
    """The player as HTML; '' where no run has a flight to show.

    Each run comes with the entries of its log that are marked on the line of time. Several runs
    are aligned at their first form steps.
    """
    shown = [(history, entries) for history, entries in runs if len(history.flight.time_s) > 1]
    if not shown:
        return ""
    several = len(runs) > 1
    found = [_run(history, entries, aligned=several) for history, entries in shown]
    return markup({"runs": found})


def _run(history: RunHistory, entries: Iterable[JournalLine], *, aligned: bool) -> dict[str, Any]:
    flight, plan = history.flight, history.plan
    kept = _thinned(flight)
    at = kept.moments
    states = flight.airborne[at] + 2 * flight.live[at]
    places = flown_moments(
        flight.time_s[at], flight.position_ned_m[at], history.deviations()[at], states
    )
    column = history.agents.index
    return {
        "name": printable(history.name),
        "by": history.by,
        "agents": history.agents,
        "labels": labels(plan),
        "inks": inks(plan),
        "r_in_m": round(plan.law.r_in * plan.unit_m, 6),
        "r_out_m": round(plan.law.r_out * plan.unit_m, 6),
        "zero_s": history.first_form_s() if aligned else 0.0,
        "off_m": round(kept.off_m + places["grain_m"] / 2, 3),
        "every_s": round(float(np.median(np.diff(flight.time_s[at]))), 3),
        **places,
        "curves": _curves(history),
        "links": [[column(i), column(j)] for i, j in history.links],
        "zones": [
            drawn_zone(
                z,
                round(since_s, 1) if math.isfinite(since_s) else None,
                round(until_s, 1) if math.isfinite(until_s) else None,
            )
            for z, since_s, until_s in history.run.zones
        ],
        "targets": [
            {
                "name": printable(track.name),
                "times": np.round(track.time_s, 2).tolist(),
                "at": np.round(track.ned_m, 2).tolist(),
            }
            for track in history.targets()
        ],
        "fence_m": plan.fence.polygon_m if plan.fence else [],
        "fence_height_m": plan.fence.height_m if plan.fence else None,
        "homes": _homes(flight),
        "steps": _steps(history),
        "marks": [_mark(entry) for entry in entries],
    }


def _thinned(flight: Flight) -> _Kept:
    """The fewest moments between which all vehicles flew straight within `OFF_M`, and no more than
    a page carries."""
    count, agents = flight.live.shape
    least_stride = -(-count * agents // _MOST)
    for stride in (*(s for s in _STRIDES if s > least_stride), least_stride):
        moments = np.append(np.arange(0, count - 1, stride), count - 1)
        off_m = _off(flight, moments)
        if off_m <= OFF_M:
            break
    return _Kept(moments, off_m)


def _off(flight: Flight, moments: NDArray[np.intp]) -> float:
    """How far [m] places are at most from straight lines between those of `moments`."""
    time_s, places = flight.time_s, flight.position_ned_m
    worst = 0.0
    for k in range(places.shape[1]):
        straight = [np.interp(time_s, time_s[moments], places[moments, k, c]) for c in range(3)]
        off = np.linalg.norm(places[:, k] - np.stack(straight, axis=-1), axis=-1)
        worst = max(worst, float(np.nanmax(off, initial=0.0)))
    return worst


def _homes(flight: Flight) -> list[list[float] | None]:
    """Where each vehicle stood at first, (north, east) [m]; None where it was in the air."""
    found: list[list[float] | None] = []
    for k, places in enumerate(np.moveaxis(flight.position_ned_m, 1, 0)):
        known = np.flatnonzero(np.isfinite(places).all(axis=-1))
        stood = len(known) > 0 and not flight.airborne[known[0], k]
        found.append(np.round(places[known[0], :2], 2).tolist() if stood else None)
    return found


def _curves(history: RunHistory) -> dict[str, str]:
    """The values at each moment of the flight: exact, whatever the page keeps of the places."""
    near = history.nearest()
    first = np.argmin(np.where(np.isnan(near), np.inf, near), axis=1)
    points = history.flight.points_m
    rows = np.arange(len(points))
    apart = np.linalg.norm(points - points[rows, first][:, None], axis=-1)
    apart[rows, first] = np.inf
    second = np.argmin(np.where(np.isnan(apart), np.inf, apart), axis=1)
    error_m = -least(-np.linalg.norm(history.deviations(), axis=-1))
    pairs = np.stack((first, second), axis=-1)
    return curves(history.flight.time_s, least(near), pairs, error_m)


def _steps(history: RunHistory) -> list[dict[str, Any]]:
    """Each beginning of a step, with the steps of all groups then: `scouts move, sweepers hold`."""
    begun = sorted(
        (group.start_s(k), number, k)
        for number, group in enumerate(history.run.groups)
        for k in group.begun
        if not group.plan.waits_on(k)
    )
    found, now = dict[float, str](), dict[int, str]()
    for start_s, number, k in begun:
        flown = history.run.groups[number].plan
        # who flies on in another group flies no more in the one before
        for other in [n for n in now if n < number]:
            before = history.run.groups[other].plan
            if before.last < flown.before + 1 and before.members & flown.members:
                del now[other]
        name = "" if flown.name == EVERYONE else f"{flown.name} "
        now[number] = f"{name}{flown.step_name(k)}"
        found[round(start_s, 3)] = ", ".join(now[n] for n in sorted(now))
    return [{"t": at_s, "text": text} for at_s, text in found.items()]


def _mark(entry: JournalLine) -> dict[str, Any]:
    return {
        "t": round(entry.time_s, 3),
        "level": entry.level.name.lower(),
        "text": f"{entry.kind}: {printable(entry.text)}",
    }
