"""A mission's zones as the plan has them."""

from __future__ import annotations

from swarm_ctl.core.model.plan import Zone
from swarm_ctl.core.safety.among_zones import AmongZones
from swarm_ctl.mission.steps.step_kind import Mission


def zones_of(mission: Mission) -> tuple[Zone, ...]:
    """In metres; lengths of the mission are in units."""
    unit, found = mission.unit_m, list[Zone]()
    for name, zone in mission.zones.items():
        corners = zone.polygon or ((zone.circle,) if zone.circle else ())
        found.append(
            Zone(
                name=name,
                corners_m=tuple((n * unit, e * unit) for n, e in corners),
                radius_m=(zone.radius or 0.0) * unit,
                clearance_m=zone.clearance_m or 0.5 * mission.law.r_in * unit,
                floor_m=zone.floor_m,
                ceiling_m=zone.ceiling_m,
            )
        )
    return tuple(found)


def among_zones(mission: Mission, heights_m: tuple[float, float]) -> AmongZones:
    """The ways of a mission, lengths in units, between two heights."""
    unit = mission.unit_m
    fence_m = [(n * unit, e * unit) for n, e in mission.fence.polygon or ()]
    return AmongZones(zones_of(mission), fence_m, heights_m)
