"""Whether a vehicle on the ground may take part: healthy, at its planned start, everybody with the same plan."""

from __future__ import annotations

import math

from swarm_ctl.core.navigation import AGREE_M, Navigator, OwnFix
from swarm_ctl.core.peers import Peers
from swarm_ctl.core.plan import Plan
from swarm_ctl.core.state import StationBeacon
from swarm_ctl.core.vehicle import VehicleView


def not_ready(
    plan: Plan,
    own_id: int,
    view: VehicleView,
    fix: OwnFix | None,
    navigator: Navigator,
    peers: Peers,
    station: tuple[StationBeacon, float] | None,
    *,
    was_armed: bool,
) -> str:
    """What keeps the agent `own_id` from taking off, or ''."""
    if not view.healthy or fix is None:
        return view.health_reason or "no position yet"
    if view.armed and not was_armed:
        return "the vehicle is armed already; disarm it first"
    unit = plan.unit_m
    start = plan.agent(own_id).start
    off = math.dist((start[0] * unit, start[1] * unit), fix.position_ned_m[:2])
    if off > unit:
        return f"the vehicle stands {off:.1f} m from its planned start; allowed: {unit:g} m"
    apart = navigator.disagreement_m(view, fix)
    if apart > AGREE_M:
        return f"global and local position differ by {apart:.1f} m; allowed: {AGREE_M:g} m"
    reserve = plan.policies.battery_reserve_percent
    if view.battery_percent is not None and view.battery_percent < reserve:
        return f"battery at {view.battery_percent:.0f} %; allowed: the reserve of {reserve:g} % and more"
    return _other_plan(plan.hash(), peers, station)


def _other_plan(own: int, peers: Peers, station: tuple[StationBeacon, float] | None) -> str:
    hashes = [(f"agent {p.id}", p.state.plan_hash) for p in peers if p.state is not None]
    if station is not None:
        hashes.append((f"station {station[0].station}", station[0].plan_hash))
    for who, plan_hash in hashes:
        if plan_hash != own:
            return f"{who} has another plan ({plan_hash:016x}, ours is {own:016x})"
    return ""
