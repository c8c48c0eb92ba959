"""Shapes as slots: one pure function for each kind, in a table.

Slots are (n, 2) arrays of (north, east) in units. Only their differences matter.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.mission.sections import shape_sections

Array: TypeAlias = npt.NDArray[np.float64]


def slots_of(shape: shape_sections.Shape, agents: int) -> Array:
    """The slots of a shape, turned; (n, 2) with n = `slot_count(shape, agents)`."""
    slots = _SLOTS[type(shape)](shape, slot_count(shape, agents))
    return slots @ _turn(math.radians(shape.rotation_deg)).T


def ups_of(shape: shape_sections.Shape, agents: int) -> list[float]:
    """How far each slot is above the flight height [m]."""
    count = slot_count(shape, agents)
    return [shape.up_m] * count if isinstance(shape.up_m, float | int) else list(shape.up_m)


def slot_count(shape: shape_sections.Shape, agents: int) -> int:
    """How many slots a shape has: its offsets, its `count`, or one per agent."""
    if isinstance(shape, shape_sections.OffsetsShape):
        return len(shape.offsets)
    return getattr(shape, "count", None) or agents


def _turn(angle_rad: float) -> Array:
    """The matrix that turns (north, east) clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])


def _ring(shape: shape_sections.RingShape, count: int) -> Array:
    if shape.radius is not None:
        return _circle(shape.radius, count)
    # A chord of length side spans 1 / count of the circle; one slot alone has no chord.
    radius = (shape.side or 0.0) / (2 * math.sin(math.pi / count)) if count > 1 else 0.0
    return _circle(radius, count)


def _circle(radius: float | Array, count: int) -> Array:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def _centred_circle(shape: shape_sections.CircleShape, count: int) -> Array:
    middle = np.zeros((1, 2))
    return np.vstack([middle, _circle(shape.radius, count - 1)]) if count > 1 else middle


def _letters(shape: shape_sections.LettersShape, count: int) -> Array:
    return letter_slots(shape.text, shape.height, count)


def _imported(shape: shape_sections.CsvShape, _count: int) -> Array:
    raise LookupError(f"{shape.path} has not been read")  # csv_slots puts offsets in its place


def _line(shape: shape_sections.LineShape, count: int) -> Array:
    return np.stack([np.zeros(count), shape.spacing * np.arange(count)], axis=-1)


def _column(shape: shape_sections.ColumnShape, count: int) -> Array:
    return np.stack([-shape.spacing * np.arange(count), np.zeros(count)], axis=-1)


def _grid(shape: shape_sections.GridShape, count: int) -> Array:
    columns = shape.columns or math.isqrt(count - 1) + 1
    row, column = np.divmod(np.arange(count), columns)
    return shape.spacing * np.stack([-row, column], axis=-1).astype(np.float64)


def _vee(shape: shape_sections.VeeShape, count: int) -> Array:
    index = np.arange(count)
    rank, side = (index + 1) // 2, np.where(index % 2 == 1, -1.0, 1.0)
    half = math.radians(shape.angle_deg) / 2
    return shape.spacing * np.stack([-rank * math.cos(half), side * rank * math.sin(half)], axis=-1)


def _wedge(shape: shape_sections.WedgeShape, count: int) -> Array:
    places = [(row, k - row / 2) for row in range(count) for k in range(row + 1)][:count]
    return shape.spacing * np.array([(-row * math.sqrt(3) / 2, east) for row, east in places])


def _star(shape: shape_sections.StarShape, count: int) -> Array:
    return _circle(np.where(np.arange(count) % 2 == 0, shape.radius, shape.inner_radius), count)


def _offsets(shape: shape_sections.OffsetsShape, _count: int) -> Array:
    return np.array(shape.offsets, dtype=np.float64)


_SLOTS: dict[type, Callable[[Any, int], Array]] = {
    shape_sections.RingShape: _ring,
    shape_sections.CircleShape: _centred_circle,
    shape_sections.LettersShape: _letters,
    shape_sections.CsvShape: _imported,
    shape_sections.LineShape: _line,
    shape_sections.ColumnShape: _column,
    shape_sections.GridShape: _grid,
    shape_sections.VeeShape: _vee,
    shape_sections.WedgeShape: _wedge,
    shape_sections.StarShape: _star,
    shape_sections.OffsetsShape: _offsets,
}


_WIDTH: Final = 2 / 3
_GAP: Final = 1 / 3
# A stroke font: points are (north, east); a letter is 1 high and 2/3 wide.
# A word is one stroke through points of a grid with 3 columns (a to c, west to east) and 5 rows
# (1 to 5, south to north).
_STROKES: Final[dict[str, str]] = {
    "A": "a1a4b5c4c1 a3c3",
    "B": "a1a5b5c4b3a3 b3c2b1a1",
    "C": "c5a5a1c1",
    "D": "a1a5b5c4c2b1a1",
    "E": "c5a5a1c1 a3c3",
    "F": "c5a5a1 a3c3",
    "G": "c5a5a1c1c3b3",
    "H": "a1a5 c1c5 a3c3",
    "I": "b1b5",
    "J": "c5c2b1a2",
    "K": "a1a5 c5a3c1",
    "L": "a5a1c1",
    "M": "a1a5b3c5c1",
    "N": "a1a5c1c5",
    "O": "a1a5c5c1a1",
    "P": "a1a5c5c3a3",
    "Q": "a1a5c5c1a1 b2c1",
    "R": "a1a5c5c3a3 b3c1",
    "S": "c5a5a3c3c1a1",
    "T": "a5c5 b5b1",
    "U": "a5a1c1c5",
    "V": "a5b1c5",
    "W": "a5a1b3c1c5",
    "X": "a1c5 a5c1",
    "Y": "a5b3c5 b3b1",
    "Z": "a5c5a1c1",
    "0": "a1a5c5c1a1",
    "1": "a4b5b1",
    "2": "a5c5c3a3a1c1",
    "3": "a5c5c1a1 a3c3",
    "4": "a5a3c3 c5c1",
    "5": "c5a5a3c3c1a1",
    "6": "c5a5a1c1c3a3",
    "7": "a5c5b1",
    "8": "a1a5c5c1a1 a3c3",
    "9": "c3a3a5c5c1a1",
    " ": "",
}


def letter_slots(text: str, height: float, count: int) -> Array:
    """`count` slots evenly along the strokes of `text`; (count, 2), in the unit of `height`."""
    points = _sampled(_strokes(text), 200 * max(1, count // 10 + 1))
    return _spread(points, count) * height


def _strokes(text: str) -> list[Array]:
    found = []
    for place, letter in enumerate(text.upper()):
        for word in _STROKES[letter].split():
            grid = [("abc".index(word[k]), int(word[k + 1]) - 1) for k in range(0, len(word), 2)]
            east0 = place * (_WIDTH + _GAP)
            found.append(np.array([(row / 4, east0 + column * _WIDTH / 2) for column, row in grid]))
    return found or [np.zeros((1, 2))]


def _sampled(strokes: list[Array], count: int) -> Array:
    """At least `count` points along all strokes, corners included; (m, 2)."""
    length = sum(float(np.linalg.norm(np.diff(stroke, axis=0), axis=1).sum()) for stroke in strokes)
    points = []
    for stroke in strokes:
        for a, b in itertools.pairwise(stroke):
            steps = max(1, round(count * float(np.linalg.norm(b - a)) / length))
            points.append(a + np.linspace(0, 1, steps + 1)[:, None] * (b - a))
    return np.vstack(points) if points else strokes[0]


def _spread(points: Array, count: int) -> Array:
    """Choose `count` points, each time the one farthest from those chosen before."""
    chosen = [0]
    away = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count:
        k = int(np.argmax(np.round(away, 9)))
        chosen.append(k)
        away = np.minimum(away, np.linalg.norm(points - points[k], axis=1))
    return points[chosen]
