"""Shapes as slots: one pure function for each kind, in a table.

Slots are (n, 2) arrays of (north, east) in units. Only their differences matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.mission.geometry import letters
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
    return letters.slots(shape.text, shape.height, count)


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
