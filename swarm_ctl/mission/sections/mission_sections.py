"""The smaller sections of a mission file: fields, ranges, defaults.

Their docstrings are the descriptions in the published JSON Schema. What several fields must be
together is in `checks/mission_checks.py`.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from swarm_ctl.core.kernel.heights import wake_reach_m
from swarm_ctl.core.model.plan import (
    Compensation,
    Geodetic,
    Limits,
    Policies,
    Safety,
    Wake,
    slot_layer_m,
)
from swarm_ctl.mission.sections.section import AgentId, Length, NorthEast, Section, Written


class OriginSection(Written[Geodetic]):
    """Origin of the common frame (WGS-84)."""


class LawSection(Section):
    """The formation law's parameters."""

    r: Length
    """Interaction range: agents that start within it are neighbours."""
    r_out: Length
    """Outer radius of the avoidance region: closer than this, agents repel each other. Slots must
    lie further apart."""
    r_in: Length
    """Inner radius of the avoidance region: the least distance between two vehicles."""
    compensation: Annotated[Compensation, Field(strict=False)] = Compensation.STOP_POINT
    """The points that the law works on: stop_point (where each vehicle would come to rest; for
    vehicles with dead time and lag), or none (positions, as in the paper)."""
    kappa: float | None = Field(default=None, gt=0, le=1000)
    """Law iterations per second. Default: 1 / tick_s."""
    h: float | None = Field(default=None, gt=0, le=1)
    """Consensus gain per iteration. Default: 4 / kappa with stop points (1 / kappa without
    safety.filter or safety.release), and 0.005, the paper's, without stop points."""
    delta_l: float = Field(default=2.0, ge=2, le=100)
    """Offset of the paper's D (equation 66)."""
    delta_a: float = Field(default=0.1, gt=0, le=100)
    """Offset of the repulsion's gain sigma above its lower bound (equation 67)."""
    own: str | None = None
    """Another law in place of the paper's, by its name; `swarm-ctl law` lists those that are here.
    `paper`, and the default, is the paper's."""
    parameters: dict[str, float] = Field(default_factory=dict, max_length=100)
    """Numbers of that law, by name, within the bounds that it gives. Default of each: the law's."""


class SafetySection(Written[Safety]):
    """What stands between the law and the vehicles. Default of each: on with stop points, off
    without (as in the paper)."""


class WakeSection(Written[Wake]):
    """The air below a vehicle: how far in height two vehicles have to be from each other to fly
    above each other."""

    def by_rotors(self) -> Wake:
        """As the plan has it."""
        reach_m = wake_reach_m(self.rotor_distance_m)  # type: ignore[attr-defined]
        return self.planned(layer_m=math.ceil(10.0 * reach_m) / 10.0)

    def spacing_m(self, limits: Written[Limits]) -> float:
        """From layer to layer at least."""
        needed_m = slot_layer_m(self.by_rotors().layer_m, limits.planned())
        return math.ceil(10.0 * needed_m - 1e-9) / 10.0


class AgentEntry(Section):
    """One agent of the mission."""

    id: AgentId
    start: NorthEast
    """Where its vehicle stands before take-off: [north, east] of the origin."""
    waits: bool = False
    """It stays on the ground until an order `launch`, and joins the others then. Its places in
    shapes stay free as long."""


class PolicySection(Written[Policies]):
    """What an agent does when something that it relies on fails: continue, hold, land or return."""

    def at_speed(self, speed_mps: float) -> Policies:
        """As the plan has it, where vehicles may fly so fast."""
        return self.planned(max_speed_mps=2 * speed_mps, return_speed_mps=speed_mps / 2)


class FenceSection(Section):
    """The geofence: where vehicles may be."""

    polygon: Annotated[tuple[NorthEast, ...], Field(min_length=3, max_length=200)] | None = None
    """Corners in order, [north, east] of the origin. Default: 100 m around everything planned."""
    height_m: float = Field(default=120.0, ge=2, le=500)
    """Above each vehicle's own take-off point."""


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
