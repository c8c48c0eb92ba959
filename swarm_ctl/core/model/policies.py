"""What an agent does about each loss or excess, and when it counts as one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Policy(StrEnum):
    """What an agent does when something it relies on is lost."""

    CONTINUE = "continue"
    HOLD = "hold"
    LAND = "land"
    """Hold for `hold_before_land_s`, then land in place."""
    RETURN = "return"
    """All at once, in layers of height, back to the own start; land in place where that is not
    possible."""


@dataclass(frozen=True, slots=True)
class Policies:
    """What an agent does about each loss or excess, and when it counts as one [mission s]."""

    agent_lost: Policy = Policy.LAND
    agent_lost_after_s: float = 5.0
    override_pause_s: float = 120.0
    """For so long at most, a command to some agents alone holds the mission up for the others; then
    those agents have left (`left_by_order`)."""
    left_by_order: Policy = Policy.CONTINUE
    """What the others do when an operator lands, calls back or kills some agents alone. `hold`
    lasts until the operator commands `resume`."""
    station_lost: Policy = Policy.LAND
    station_lost_after_s: float = 5.0
    hold_before_land_s: float = 3.0
    fence: Policy = Policy.LAND
    """Outside `Plan.fence`, or about to be: the stop point counts."""
    battery_low: Policy = Policy.LAND
    battery_reserve_percent: float = 20.0
    too_fast: Policy = Policy.LAND
    """Faster than `max_speed_mps`, or leaning more than `max_tilt_deg`: the vehicle no longer does
    what it is told."""
    max_speed_mps: float = 10.0
    max_tilt_deg: float = 60.0
    """A PX4 leans up to 45 degrees after a large step of its setpoint (MPC_TILTMAX_AIR), and a
    little beyond: 48 was seen."""
    wind: Policy = Policy.LAND
    """Stronger wind than `wind_limit_mps`, where the vehicle estimates it; where not, the tilt
    limit stands in."""
    wind_limit_mps: float = 12.0
    estimate: Policy = Policy.HOLD
    """In the air, when the vehicle says for `timeouts.ESTIMATE_DOUBT_S` that its own estimate is
    faulty, or less accurate than `position_accuracy_flight_m`."""
    position_accuracy_m: float = 1.0
    """With a less accurate position (one standard deviation) no vehicle takes off."""
    position_accuracy_flight_m: float = 2.0
    return_separation_m: float = 3.0
    """Between the heights of two agents that return."""
    return_speed_mps: float = 2.5
