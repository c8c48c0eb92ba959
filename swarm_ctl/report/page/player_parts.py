"""What every page with the player is made of: markup, script, style, colours, and the form in which
it gets a flight. It needs no matplotlib, so that a ground station can serve the player, too.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterable
from importlib import resources
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import printable
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.station.picture.colours import COLOURS, first_groups

Floats = NDArray[np.float64]

_FINEST_M: Final = 0.01
_LARGEST: Final = 32_000
_UNKNOWN: Final = -32_768
"""The whole number of a place that is not known."""


def script_hash(script: str) -> str:
    """What a content security policy knows a script by."""
    digest = hashlib.sha256(script.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def script() -> str:
    """The player's own."""
    return _asset("player.js")


def style() -> str:
    """The player's part of a page's style."""
    return _asset("player.css")


def markup(data: dict[str, Any]) -> str:
    """The player as HTML, with the flights that it shows at first as JSON. Nothing of a run becomes
    markup or program."""
    text = json.dumps({"colours": COLOURS, **data}, allow_nan=False)
    for mark in "<>&":
        text = text.replace(mark, f"\\u{ord(mark):04x}")
    return (
        f'<script type="application/json" id="flight">{text}</script>'
        f"{_asset('player.html')}<script>{script()}</script>"
    )


def flown_moments(
    time_s: Floats, ned_m: Floats, away_m: Floats, states: NDArray[Any]
) -> dict[str, Any]:
    """T moments of a flight of n vehicles, as the player reads them.

    Args:
        time_s: (T,)
        ned_m: (T, n, 3) north, east, down; nan where a place is not known.
        away_m: (T, n, 2) north, east from each one's slot; nan where it has none.
        states: (T, n) 1 in the air, plus 2 under its agent.
    """
    middle_m, grain_m = _scale(ned_m)
    return {
        "middle_m": middle_m.tolist(),
        "grain_m": grain_m,
        "times_s": packed(time_s, "<f4"),
        "places": packed(_whole(ned_m - middle_m, grain_m), "<i2"),
        "away": packed(_whole(away_m, grain_m), "<i2"),
        "states": packed(states, "u1"),
    }


def curves(time_s: Floats, near_m: Floats, pairs: NDArray[Any], error_m: Floats) -> dict[str, str]:
    """The values over T moments: distance of the nearest pair (T,), which one it is (T, 2), and the
    formation error (T,); nan where one is not known."""
    return {
        "times_s": packed(time_s, "<f4"),
        "near_m": packed(near_m, "<f4"),
        "pairs": packed(pairs, "<u2"),
        "error_m": packed(error_m, "<f4"),
    }


def labels(plan: Plan) -> list[str]:
    """The agents' ids; the first of a group has its name, too."""
    found = first_groups(plan)
    return [
        f"{agent.id} {name}" if name and name not in found[:k] else str(agent.id)
        for k, (agent, name) in enumerate(zip(plan.agents, found, strict=True))
    ]


def drawn_zone(zone: Zone, since_s: float | None, until_s: float | None) -> dict[str, Any]:
    """A zone, and while it holds (None: from the start, to the end)."""
    return {
        "name": printable(zone.name),
        "at": zone.outline_m,
        "floor": zone.floor_m,
        "ceiling": zone.ceiling_m,
        "since": since_s,
        "until": until_s,
    }


def packed(values: Iterable[Any] | NDArray[Any], kind: str) -> str:
    """The values' bytes, of this kind of numbers, as base64."""
    return base64.b64encode(np.asarray(values).astype(kind).tobytes()).decode()


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


def _asset(name: str) -> str:
    return (resources.files(__package__ or "") / "assets" / name).read_text("utf-8")
