"""The player of a page: one flight, or several over one another, on canvas.

`assets/player.js` draws what this module writes. Nothing of the run becomes markup or program: the
page carries it as JSON, and its content security policy lets the player's own script run alone.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.plan import EVERYONE
from swarm_ctl.core.model.text import printable
from swarm_ctl.report.page.drawing import COLOURS
from swarm_ctl.report.page.run_history import RunHistory, least
from swarm_ctl.runfolder.flight import Flight
from swarm_ctl.runfolder.truth import Floats
from swarm_ctl.station.picture.journal import JournalLine

OFF_M: Final = 0.05
"""What is drawn between the moments that the page keeps may be off by this much."""
_STRIDES: Final = (10, 5, 3, 2)
_MOST: Final = 200_000
"""Moments times agents that a page keeps at most: 11 bytes each."""
_FINEST_M: Final = 0.01
_LARGEST: Final = 32_000
_UNKNOWN: Final = -32_768
"""The whole number of a place that is not known."""


@dataclass(frozen=True, slots=True)
class _Kept:
    """The moments of a flight that the page has, and how far off a straight line between them
    is."""

    moments: NDArray[np.intp]
    off_m: float


def script_hash() -> str:
    """What a content security policy knows the player's script by."""
    digest = hashlib.sha256(_asset("player.js").encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def style() -> str:
    """The player's part of the page's style."""
    return _asset("player.css")


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
    text = json.dumps({"colours": COLOURS, "runs": found}, allow_nan=False)
    for mark in "<>&":
        text = text.replace(mark, f"\\u{ord(mark):04x}")
    return (
        f'<script type="application/json" id="flight">{text}</script>'
        f"{_asset('player.html')}<script>{_asset('player.js')}</script>"
    )


def _run(history: RunHistory, entries: Iterable[JournalLine], *, aligned: bool) -> dict[str, Any]:
    flight, plan = history.flight, history.plan
    kept = _thinned(flight)
    at = kept.moments
    middle_m, grain_m = _scale(flight.position_ned_m)
    column = history.agents.index
    return {
        "name": printable(history.name),
        "by": history.by,
        "agents": history.agents,
        "labels": history.labels,
        "inks": history.inks,
        "r_in_m": round(plan.law.r_in * plan.unit_m, 6),
        "r_out_m": round(plan.law.r_out * plan.unit_m, 6),
        "zero_s": history.first_form_s() if aligned else 0.0,
        "off_m": round(kept.off_m + grain_m / 2, 3),
        "every_s": round(float(np.median(np.diff(flight.time_s[at]))), 3),
        "middle_m": middle_m.tolist(),
        "grain_m": grain_m,
        "times_s": _packed(flight.time_s[at], "<f4"),
        "places": _packed(_whole(flight.position_ned_m[at] - middle_m, grain_m), "<i2"),
        "away": _packed(_whole(history.deviations()[at], grain_m), "<i2"),
        "states": _packed(flight.airborne[at] + 2 * flight.live[at], "u1"),
        "curves": _curves(history),
        "links": [[column(i), column(j)] for i, j in history.links],
        "zones": [
            {
                "name": printable(z.name),
                "at": z.outline_m,
                "floor": z.floor_m,
                "ceiling": z.ceiling_m,
                "since": round(since_s, 1) if math.isfinite(since_s) else None,
                "until": round(until_s, 1) if math.isfinite(until_s) else None,
            }
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


def _scale(places: Floats) -> tuple[Floats, float]:
    """The middle of all places (3,), and the grain [m] in which 16 bits reach them all."""
    there = places[np.isfinite(places).all(axis=-1)]
    if not len(there):
        return np.zeros(3), _FINEST_M
    low, high = there.min(axis=0), there.max(axis=0)
    return (low + high) / 2, max(_FINEST_M, float((high - low).max()) / _LARGEST)


def _whole(values: Floats, grain_m: float) -> NDArray[np.int16]:
    known = np.isfinite(values)
    steps = np.clip(np.round(np.where(known, values, 0.0) / grain_m), -_LARGEST, _LARGEST)
    return np.where(known, steps, _UNKNOWN).astype(np.int16)


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
    return {
        "times_s": _packed(history.flight.time_s, "<f4"),
        "near_m": _packed(least(near), "<f4"),
        "pairs": _packed(np.stack((first, second), axis=-1), "<u2"),
        "error_m": _packed(error_m, "<f4"),
    }


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


def _packed(values: NDArray[Any], kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode()


def _asset(name: str) -> str:
    return (resources.files(__package__ or "") / "assets" / name).read_text("utf-8")
