"""The shapes that a mission may name: a class each, and the union `Shape`."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from swarm_ctl.core.model.plan import MOST_UP_M
from swarm_ctl.mission.sections.section import Angle, Length, NorthEast, Section

Up = Annotated[float, Field(ge=-MOST_UP_M, le=MOST_UP_M)]


class _ShapeSection(Section):
    rotation_deg: Angle = 0.0
    """Turns the whole shape clockwise."""
    up_m: Up | Annotated[tuple[Up, ...], Field(min_length=1, max_length=1000)] = 0.0
    """How far above the flight height (the take-off's) the slots are, below it where negative: one
    number for all, or a list of one for each slot."""


class _CountedShape(_ShapeSection):
    count: int | None = Field(default=None, ge=1, le=1000)
    """Number of slots. Default: one per agent."""


class RingShape(_CountedShape):
    """Slots evenly on a circle, clockwise from north. Give `side` or `radius`."""

    kind: Literal["ring"]
    side: Length | None = None
    """Distance between adjacent slots."""
    radius: Length | None = None


class LineShape(_CountedShape):
    """Line abreast: slots from west to east."""

    kind: Literal["line"]
    spacing: Length


class ColumnShape(_CountedShape):
    """Line in trail: slots from north to south."""

    kind: Literal["column"]
    spacing: Length


class GridShape(_CountedShape):
    """Rows of slots from west to east, the northern row first."""

    kind: Literal["grid"]
    spacing: Length
    columns: int | None = Field(default=None, ge=1, le=1000)
    """Slots per row. Default: as square as possible."""


class VeeShape(_CountedShape):
    """A leader in the north, the other slots alternately on its left and right arm."""

    kind: Literal["vee"]
    spacing: Length
    """Distance between adjacent slots of an arm."""
    angle_deg: float = Field(default=90.0, ge=20, le=180)
    """Between the arms; from 60 on, slots of different arms are at least `spacing` apart."""


class WedgeShape(_CountedShape):
    """A filled triangle: rows of one, two, three ... slots from north to south, adjacent ones
    `spacing` apart."""

    kind: Literal["wedge"]
    spacing: Length


class CircleShape(_CountedShape):
    """One slot in the middle, the others evenly on a circle around it, clockwise from north."""

    kind: Literal["circle"]
    radius: Length


class LettersShape(_CountedShape):
    """Text in a simple stroke font, slots evenly along the strokes."""

    kind: Literal["letters"]
    text: Annotated[str, Field(pattern=r"^[A-Za-z0-9 ]{1,12}$", examples=["A", "HELLO"])]
    height: Length
    """Of a letter; its width is two thirds of that."""


class CsvShape(_ShapeSection):
    """Slots from a CSV file with two columns, north and east, or three: north, east, and `up_m` in
    metres. A first line of names is skipped."""

    kind: Literal["csv"]
    path: Annotated[str, Field(min_length=1, max_length=400)]
    """Path of the CSV file, relative to the mission file."""


class StarShape(_CountedShape):
    """Slots alternately on an outer and an inner circle, clockwise from north, the first one
    outside."""

    kind: Literal["star"]
    radius: Length
    inner_radius: Length


class OffsetsShape(_ShapeSection):
    """Any slots, given one by one."""

    kind: Literal["offsets"]
    offsets: tuple[NorthEast, ...] = Field(min_length=1, max_length=1000)
    """[north, east] of each slot."""


Shape: TypeAlias = Annotated[
    RingShape
    | CircleShape
    | LineShape
    | ColumnShape
    | GridShape
    | VeeShape
    | WedgeShape
    | StarShape
    | LettersShape
    | OffsetsShape
    | CsvShape,
    Field(discriminator="kind"),
]
