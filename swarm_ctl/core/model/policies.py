"""What an agent does about each loss or excess, and when it counts as one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Final, TypeAlias

from annotated_types import Ge, Le


class Policy(StrEnum):
    """What an agent does when something it relies on is lost."""

    CONTINUE = "continue"
    HOLD = "hold"
    LAND = "land"
    """Hold for `hold_before_land_s`, then land in place."""
    RETURN = "return"
    """All at once, in layers of height, back to the own start; land in place where that is not
    possible."""


DERIVED: Final = object()
"""Marks a field of the plan that follows from others where a mission file does not give it."""
LossTime: TypeAlias = Annotated[float, Ge(1), Le(60)]
Accuracy: TypeAlias = Annotated[float, Ge(0.05), Le(50)]


@dataclass(frozen=True, slots=True)
class Policies:
    """What an agent does about each loss or excess, and when it counts as one [mission s]."""

    agent_lost: Policy = Policy.LAND
    """When a peer was not heard for `agent_lost_after_s`."""
    agent_lost_after_s: LossTime = 5.0
    override_pause_s: Annotated[float, Ge(0), Le(3600)] = 120.0
    """For so long at most, a command to some agents alone (`hold --agents 2`) holds the mission up
    for the others. Then these agents have left, and `left_by_order` acts."""
    left_by_order: Policy = Policy.CONTINUE
    """What the others do when an operator lands, calls back or kills some agents alone (`land
    --agents 3`): go on without them, hold until the operator commands `resume`, land or return."""
    station_lost: Policy = Policy.LAND
    """When no station was heard for `station_lost_after_s`."""
    station_lost_after_s: LossTime = 5.0
    hold_before_land_s: Annotated[float, Ge(0), Le(60)] = 3.0
    """How long a policy of land holds before it lands."""
    fence: Policy = Policy.LAND
    """When the vehicle is outside the geofence, or can't stop inside."""
    battery_low: Policy = Policy.LAND
    """When less than `battery_reserve_percent` is left in the air."""
    battery_reserve_percent: Annotated[float, Ge(0), Le(90)] = 20.0
    """With less than this no vehicle takes off."""
    too_fast: Policy = Policy.LAND
    """When the vehicle flies faster than `max_speed_mps` or tilts more than `max_tilt_deg`."""
    max_speed_mps: Annotated[float, Ge(0.5), Le(60), DERIVED] = 10.0
    """Default: twice vehicle.limits.speed_mps, at least 0.5."""
    # A PX4 leans up to 45 degrees after a large step of its setpoint (MPC_TILTMAX_AIR), and a
    # little beyond: 48 was seen.
    max_tilt_deg: Annotated[float, Ge(5), Le(90)] = 60.0
    wind: Policy = Policy.LAND
    """When the vehicle estimates more wind than `wind_limit_mps`. Vehicles that do not estimate the
    wind have the tilt limit instead."""
    wind_limit_mps: Annotated[float, Ge(1), Le(30)] = 12.0
    estimate: Policy = Policy.HOLD
    """When the vehicle says in the air that its own estimate is faulty, or less accurate than
    `position_accuracy_flight_m`."""
    position_accuracy_m: Accuracy = 1.0
    """With a less accurate position, by its own word, no vehicle takes off."""
    position_accuracy_flight_m: Accuracy = 2.0
    return_separation_m: Annotated[float, Ge(0), Le(20)] = 3.0
    """Between the layers in which agents return."""
    return_speed_mps: Annotated[float, Ge(0.1), Le(20), DERIVED] = 2.5
    """Default: half of vehicle.limits.speed_mps, at least 0.1."""
