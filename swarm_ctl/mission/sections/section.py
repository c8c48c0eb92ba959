"""The base of every section of a mission file, and the types of fields that several have.

Lengths with a suffix (`_m`) are in metres; other lengths are in what `lengths` says. Horizontal
vectors are [north, east]. Angles are degrees clockwise from north, seen from above.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from swarm_ctl.core.model.plan import Policy

AgentId = Annotated[int, Field(ge=1, le=65535)]
Length = Annotated[float, Field(gt=0, le=1000)]
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000)]
NorthEast = tuple[Coordinate, Coordinate]
Angle = Annotated[float, Field(ge=-360, le=360)]
Timeout = Annotated[float, Field(gt=0, le=3600)]
Name = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,39}$", examples=["hexagon", "search-line_2"])
]
Action = Annotated[Policy, Field(strict=False)]
Link = tuple[AgentId, AgentId]
Links = Annotated[tuple[Link, ...], Field(min_length=1, max_length=31125)]


class Section(BaseModel):
    """Strict: no unknown field, no silent conversion, no NaN or infinity."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
        defer_build=True,  # sections are read as parts of the file, which is built as one
    )
