"""How all vehicles of a mission answer, and the most that agents command them."""

from __future__ import annotations

from swarm_ctl.core.model.plan import Limits, Response
from swarm_ctl.mission.sections.section import Section
from swarm_ctl.mission.sections.written import Written


class VehicleResponse(Written[Response]):
    """How vehicles answer a velocity setpoint; stop points are computed with it."""


class VehicleLimits(Written[Limits]):
    """The most that an agent commands."""


class VehicleSection(Section):
    """What holds for all vehicles of the mission."""

    response: VehicleResponse = VehicleResponse()
    limits: VehicleLimits = VehicleLimits()
