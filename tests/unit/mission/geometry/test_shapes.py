"""Shapes: the spacing they promise, and their orientation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.arrays import Floats
from swarm_ctl.mission.geometry.shapes import slots_of
from swarm_ctl.mission.sections.shape_sections import Shape

ADAPTER: TypeAdapter[Shape] = TypeAdapter(Shape)


def slots(agents: int, **fields: Any) -> Floats:
    return slots_of(ADAPTER.validate_python(fields), agents)


counts = st.integers(2, 40)
spacings = st.floats(0.1, 100)


@given(
    st.sampled_from(["line", "column", "grid", "wedge", "vee"]),
    counts,
    spacings,
    st.floats(-360, 360),
)
def test_adjacent_slots_are_spacing_apart_and_none_is_closer(
    kind: str, count: int, spacing: float, turn: float
) -> None:
    assert smallest_distance(
        slots(count, kind=kind, spacing=spacing, rotation_deg=turn)
    ) == pytest.approx(spacing)


@given(counts, spacings)
def test_a_ring_by_side_has_that_side(count: int, side: float) -> None:
    ring = slots(count, kind="ring", side=side)
    assert np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1) == pytest.approx(side)
    assert np.ptp(np.linalg.norm(ring, axis=1)) == pytest.approx(0, abs=1e-9 * count * side)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"kind": "ring", "radius": 1.0}, [[1, 0], [0, 1], [-1, 0], [0, -1]]),
        ({"kind": "ring", "radius": 1.0, "rotation_deg": 90.0}, [[0, 1], [-1, 0], [0, -1], [1, 0]]),
        ({"kind": "line", "spacing": 2.0}, [[0, 0], [0, 2], [0, 4], [0, 6]]),
        (
            {"kind": "line", "spacing": 2.0, "rotation_deg": 90.0},
            [[0, 0], [-2, 0], [-4, 0], [-6, 0]],
        ),
        ({"kind": "column", "spacing": 2.0}, [[0, 0], [-2, 0], [-4, 0], [-6, 0]]),
        ({"kind": "grid", "spacing": 2.0}, [[0, 0], [0, 2], [-2, 0], [-2, 2]]),
        ({"kind": "grid", "spacing": 2.0, "columns": 3}, [[0, 0], [0, 2], [0, 4], [-2, 0]]),
        ({"kind": "vee", "spacing": math.sqrt(2)}, [[0, 0], [-1, -1], [-1, 1], [-2, -2]]),
        (
            {"kind": "wedge", "spacing": 2.0},
            [[0, 0], [-math.sqrt(3), -1], [-math.sqrt(3), 1], [-2 * math.sqrt(3), -2]],
        ),
        ({"kind": "star", "radius": 2.0, "inner_radius": 1.0}, [[2, 0], [0, 1], [-2, 0], [0, -1]]),
        ({"kind": "offsets", "offsets": ((1.0, 2.0), (3.0, 4.0))}, [[1, 2], [3, 4]]),
        ({"kind": "ring", "side": 2.0, "count": 1}, [[0, 0]]),
    ],
)
def test_where_the_slots_are(fields: dict[str, Any], expected: list[list[float]]) -> None:
    assert slots(4, **fields) == pytest.approx(np.array(expected, dtype=float), abs=1e-12)
