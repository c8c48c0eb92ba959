"""Why a mission does not go on as planned, and what an agent then does."""

from __future__ import annotations

from enum import StrEnum
from typing import Final


class Cause(StrEnum):
    """What broke a mission off, or holds it up: of one agent, or (the last four) of a whole run."""

    ORDER = "order"
    """An operator's land, return or kill, of this agent or of others (`policies.left_by_order`)."""
    STARTER = "starter"
    """The process that started the agents is gone."""
    VEHICLE = "vehicle"
    """A fault of the vehicle, by its own word or by what it did not do."""
    PILOT = "pilot"
    """A pilot or the vehicle's own failsafe took it, or switched it off."""
    FALL = "fall"
    VEHICLE_LINK = "vehicle link"
    """No heartbeat from the vehicle."""
    POSITION = "position"
    SPEED = "speed"
    """Too fast, or tilted too far."""
    WIND = "wind"
    ESTIMATE = "estimate"
    """The vehicle doubts its own position."""
    FENCE = "fence"
    BATTERY = "battery"
    PEER = "peer"
    """Another agent is silent, or gave up."""
    STATION = "station"
    """No ground station is heard."""
    TARGET = "target"
    """The target that a step follows is not heard any more."""
    TIMEOUT = "timeout"
    """A step took too long."""
    MACHINE = "machine"
    """The computer could not keep up."""
    LINK = "link"
    """States came too late, or too few of them."""
    FINDING = "finding"
    """A collision, a fall and the like: `findings` has them."""
    PROCESS = "process"
    """A process ended early, or a file of the run is missing or torn."""


class FailsafeAction(StrEnum):
    """What an agent does when a failsafe fires."""

    HOLD = "hold"
    """Stop and wait, avoidance on, until the cause is gone."""
    RETURN = "return"
    LAND = "land"
    LEAVE = "leave"
    """End at once and send nothing: the vehicle is in a flight that is not ours."""
    YIELD = "yield"
    """Send heartbeats alone until the vehicle is down: a pilot or its own failsafe flies it."""
    FALL = "fall"
    """The motors are off in the air: send heartbeats alone, as for a pilot, and count as failed."""
    KILL = "kill"
    """Motors off."""

    @property
    def rank(self) -> int:
        """An action of higher rank outweighs one of lower rank."""
        return _RANK[self]


_RANK: Final = {
    FailsafeAction.HOLD: 0,
    FailsafeAction.RETURN: 1,
    FailsafeAction.LAND: 2,
    FailsafeAction.LEAVE: 3,
    FailsafeAction.YIELD: 3,
    FailsafeAction.FALL: 4,
    FailsafeAction.KILL: 5,
}
