"""Targets of a mission file: what a formation follows."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from swarm_ctl.mission.sections.section import AgentId, NorthEast, Section


class TargetSection(Section):
    """What a formation may follow. Words on the mesh tell where it is (`swarm-ctl target`); give
    `adsb`, `agent` or `along` where the swarm hears it by itself."""

    adsb: Annotated[str, Field(pattern=r"^[0-9A-Fa-f]{6}$")] | None = None
    """ICAO address, six hexadecimal digits: the vehicles' own receivers hear it. A boat or a car
    with a transponder has one, too."""
    agent: AgentId | None = None
    """An agent of this mission, which is followed while a pilot flies it (`policies.agent_lost:
    continue`): after one of its own a formation would go on and on."""
    along: Annotated[tuple[NorthEast, ...], Field(min_length=2, max_length=200)] | None = None
    """A target for tests, which the swarm plays: its way, from when the step begins."""
    speed_mps: float | None = Field(default=None, ge=0.1, le=60)
    """Of a target that is played. Default: half of vehicle.limits.speed_mps."""
    height_m: float | None = Field(default=None, ge=-500, le=500)
    """Above the origin; 0 for a boat or a car. It is kept clear of at its height. Default: as it is
    told; of one that does not tell it, at all heights."""
