"""The smaller sections of a mission file: fields, ranges, defaults.

Their docstrings are the descriptions in the published JSON Schema. What several fields must be
together is in `checks/mission_checks.py`.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from swarm_ctl.core.model.plan import Compensation, Policy
from swarm_ctl.mission.sections.section import Action, AgentId, Length, LossTime, NorthEast, Section


class OriginSection(Section):
    """Origin of the common frame (WGS-84)."""

    lat_deg: float = Field(ge=-89, le=89)
    """Nearer to a pole, no autopilot knows where east is."""
    lon_deg: float = Field(ge=-180, le=180)
    alt_m: float = Field(ge=-500, le=9000)
    """Metres above mean sea level."""


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
    """An own law in place of the paper's: the name under which an installed package offers it.
    `paper`, and the default, is the paper's."""


class SafetySection(Section):
    """What stands between the law and the vehicles. Default of each: on with stop points, off
    without (as in the paper)."""

    filter: bool | None = None
    """Correct each velocity that would bring two vehicles closer than their keep-out distance."""
    guard: bool | None = None
    """Keep neighbour links shorter than r on the way, if the shape keeps them so."""
    release: bool | None = None
    """Resolve dead-locks: blocked agents go round each other."""
    align: bool | None = None
    """Form faster (mean error feedback): each agent also moves to where its slot lies by the mean
    of all agents that it hears, not only by its neighbours."""


class AgentEntry(Section):
    """One agent of the mission."""

    id: AgentId
    start: NorthEast
    """Where its vehicle stands before take-off: [north, east] of the origin."""


class PolicySection(Section):
    """What an agent does when something that it relies on fails: continue, hold, land or return."""

    agent_lost: Action = Policy.LAND
    """When a peer was not heard for `agent_lost_after_s`."""
    agent_lost_after_s: LossTime = 5.0
    override_pause_s: float = Field(default=120.0, ge=0, le=3600)
    """For so long at most, a command to some agents alone (`hold --agents 2`) holds the mission up
    for the others. Then these agents have left, and `left_by_order` acts."""
    left_by_order: Action = Policy.CONTINUE
    """What the others do when an operator lands, calls back or kills some agents alone (`land
    --agents 3`): go on without them, hold until the operator commands `resume`, land or return."""
    station_lost: Action = Policy.LAND
    """When no station was heard for `station_lost_after_s`."""
    station_lost_after_s: LossTime = 5.0
    hold_before_land_s: float = Field(default=3.0, ge=0, le=60)
    """How long a policy of land holds before it lands."""
    fence: Action = Policy.LAND
    """When the vehicle is outside the geofence, or can't stop inside."""
    battery_low: Action = Policy.LAND
    """When less than `battery_reserve_percent` is left in the air."""
    battery_reserve_percent: float = Field(default=20.0, ge=0, le=90)
    """With less than this no vehicle takes off."""
    too_fast: Action = Policy.LAND
    """When the vehicle flies faster than `max_speed_mps` or tilts more than `max_tilt_deg`."""
    max_speed_mps: float | None = Field(default=None, ge=0.5, le=60)
    """Default: twice vehicle.limits.speed_mps."""
    max_tilt_deg: float = Field(default=60.0, ge=5, le=90)
    wind: Action = Policy.LAND
    """When the vehicle estimates more wind than `wind_limit_mps`. Vehicles that do not estimate the
    wind have the tilt limit instead."""
    wind_limit_mps: float = Field(default=12.0, ge=1, le=30)
    estimate: Action = Policy.HOLD
    """When the vehicle says in the air that its own estimate is faulty, or less accurate than
    `position_accuracy_flight_m`."""
    position_accuracy_m: float = Field(default=1.0, ge=0.05, le=50)
    """With a less accurate position, by its own word, no vehicle takes off."""
    position_accuracy_flight_m: float = Field(default=2.0, ge=0.05, le=50)
    return_separation_m: float = Field(default=3.0, ge=0, le=20)
    """Between the layers in which agents return."""
    return_speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """Default: half of vehicle.limits.speed_mps."""


class FenceSection(Section):
    """The geofence: where vehicles may be."""

    polygon: Annotated[tuple[NorthEast, ...], Field(min_length=3, max_length=200)] | None = None
    """Corners in order, [north, east] of the origin. Default: 100 m around everything planned."""
    height_m: float = Field(default=120.0, ge=2, le=500)
    """Above each vehicle's own take-off point."""
