"""What was probably meant: a name that is written alike, or another word for the same."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Collection
from typing import Final

_OTHER_WORDS: Final = {
    # steps
    "takeoff": "take_off take-off launch arm climb ascend up start",
    "form": "formation shape arrange",
    "hold": "loiter hover wait pause stay sleep delay",
    "move": "go goto fly waypoint waypoints path travel translate transit",
    "rotate": "turn spin yaw",
    "scale": "resize shrink expand grow widen narrow",
    "return": "rtl rth home return_to_launch return_home come_back",
    "land": "landing touchdown down descend",
    # shapes
    "ring": "polygon hexagon square triangle pentagon octagon",
    "line": "row abreast",
    "column": "trail file",
    "grid": "matrix block rectangle",
    "vee": "v arrow chevron",
    "wedge": "pyramid",
    "letters": "text word letter",
    "offsets": "points slots custom list",
    # fields
    "height_m": "altitude alt altitude_m alt_m",
    "duration_s": "time seconds time_s for_s",
    "speed_mps": "velocity velocity_mps vel",
    "angle_deg": "heading degrees",
    "lat_deg": "latitude",
    "lon_deg": "longitude lng",
    "spacing": "distance gap separation",
    "start": "position pos place",
    "count": "number n",
}
"""By the file's word, what pilots and other programs call it."""
_MEANT: Final = {other: word for word, others in _OTHER_WORDS.items() for other in others.split()}


def nearest(word: str, allowed: Collection[str]) -> str:
    """The allowed word that was probably meant; '' where none is near."""
    lower, names = word.lower(), {name.lower(): name for name in allowed}
    likely = [_MEANT.get(lower, ""), *(name for name in names if name.startswith(f"{lower}_"))]
    close = [*(name for name in likely if name in names), *difflib.get_close_matches(lower, names)]
    return names[close[0]] if close else ""


def did_you_mean(word: str, allowed: Collection[str]) -> str:
    """`; did you mean hold?`, or '' where no allowed word is near."""
    near = nearest(word, allowed)
    return f"; did you mean {near}?" if near else ""


def slug(text: str) -> str:
    """The name of a mission or a shape that is nearest to a text; may be ''."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-_")[:40]
