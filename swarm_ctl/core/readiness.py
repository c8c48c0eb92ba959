"""Whether a vehicle on the ground may take part: healthy, at its planned start, everybody with the same plan."""

from __future__ import annotations

import math

from swarm_ctl.core.navigation import AGREE_M, Navigator, OwnFix
from swarm_ctl.core.peers import Peers
from swarm_ctl.core.plan import AgentPlan, Plan
from swarm_ctl.core.state import StationBeacon
from swarm_ctl.core.vehicle import VehicleView


def not_ready(plan: Plan, own: AgentPlan, view: VehicleView, fix: OwnFix | None, navigator: Navigator) -> str:
    """What keeps the vehicle of the agent `own` from taking off, or ''."""
    if not view.healthy or fix is None:
        return view.health_reason or "no position yet"
    unit = plan.unit_m
    off = math.dist((own.start[0] * unit, own.start[1] * unit), fix.position_ned_m[:2])
    if off > unit:
        return f"the vehicle stands {off:.1f} m from its planned start; allowed: {unit:g} m"
    apart = navigator.disagreement_m(view, fix)
    if apart > AGREE_M:
        return f"global and local position differ by {apart:.1f} m; allowed: {AGREE_M:g} m"
    reserve = plan.policies.battery_reserve_percent
    if view.battery_percent is not None and view.battery_percent < reserve:
        return f"battery at {view.battery_percent:.0f} %; allowed: the reserve of {reserve:g} % and more"
    return ""


def other_plan(own: int, peers: Peers, station: tuple[StationBeacon, float] | None, *, expect_station: bool) -> str:
    """Who is not heard, or has another plan than the one with the hash `own`; ''."""
    if station is None and expect_station:
        return "no ground station heard yet"
    hashes = [(f"agent {p.id}", p.state.plan_hash) for p in peers if p.state is not None]
    if station is not None:
        hashes.append((f"station {station[0].station}", station[0].plan_hash))
    for who, plan_hash in hashes:
        if plan_hash != own:
            return f"{who} has another plan ({plan_hash:016x}, ours is {own:016x})"
    return ""
