"""How all vehicles of a mission answer, and the most that agents command them."""

from __future__ import annotations

from pydantic import Field

from swarm_ctl.mission.sections.section import Section


class VehicleResponse(Section):
    """How vehicles answer a velocity setpoint; stop points are computed with it."""

    dead_time_s: float = Field(default=0.4, ge=0, le=2)
    """Until the vehicle begins to react."""
    lag_s: float = Field(default=0.5, ge=0.01, le=5)
    """Time constant of the velocity."""
    acceleration_mps2: float = Field(default=2.8, ge=0.1, le=20)
    """The most that the vehicle accelerates or brakes."""
    doubt_s: float = Field(default=0.5, ge=0.05, le=1)
    """Dead time and lag together may differ from the vehicle's own by this. An agent keeps the
    distance and the speed that it asks for until its flight has told better."""


class VehicleLimits(Section):
    """The most that an agent commands."""

    speed_mps: float = Field(default=5.0, ge=0.1, le=20)
    """Horizontal, by the vehicle's position. Where the velocity that the vehicle estimates is off
    by a drift, the setpoint on the wire is less by that drift: it may be up to 1 m/s more than
    this, and the vehicle's position does not move faster. Default: 5, less where
    law.r_out - law.r_in leaves less room to brake."""
    climb_mps: float = Field(default=1.0, ge=0.1, le=5)
    """After the take-off. A take-off climbs as the autopilot does: an ArduCopter flies its own, a
    PX4 is told 1.5 m/s at most (MPC_TKO_SPEED as delivered)."""
    descent_mps: float = Field(default=1.0, ge=0.1, le=3)


class VehicleSection(Section):
    """What holds for all vehicles of the mission."""

    response: VehicleResponse = VehicleResponse()
    limits: VehicleLimits = VehicleLimits()
