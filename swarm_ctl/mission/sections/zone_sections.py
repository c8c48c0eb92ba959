"""Zones of a mission file: places that vehicles keep out of."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from swarm_ctl.mission.sections.section import Length, NorthEast, Section

Height = Annotated[float, Field(ge=-500, le=500)]


class ZoneSection(Section):
    """A place that no vehicle enters. Give `polygon`, or `circle` and `radius`."""

    polygon: Annotated[tuple[NorthEast, ...], Field(min_length=3, max_length=200)] | None = None
    """Corners in order, [north, east] of the origin."""
    circle: NorthEast | None = None
    """The middle: [north, east] of the origin."""
    radius: Length | None = None
    """Of the circle."""
    floor_m: Height | None = None
    """The zone begins at this height above the origin. Default: at the ground."""
    ceiling_m: Height | None = None
    """It ends at this height above the origin. Default: nowhere."""
    clearance_m: float | None = Field(default=None, ge=0.1, le=100)
    """No vehicle comes closer. Default: half of law.r_in."""
