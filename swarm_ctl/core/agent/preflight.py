"""Whether a vehicle on the ground may take part: healthy, at its planned start, everybody with the
same plan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

from swarm_ctl.core.control.navigation import AGREE_M, Navigator, OwnFix
from swarm_ctl.core.model.messages import StationBeacon
from swarm_ctl.core.model.plan import AgentPlan, Plan
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.vehicle import VehicleView
from swarm_ctl.core.swarm.peers import Peers

HeardStation: TypeAlias = tuple[StationBeacon, float]
"""The newest beacon, and when it came."""


@dataclass(frozen=True, slots=True)
class Preflight:
    """What one agent has to see before it arms. `expect_station`: it does not arm before one is
    heard."""

    plan: Plan
    own: AgentPlan
    plan_hash: int
    navigator: Navigator
    peers: Peers
    expect_station: bool

    def closed_by(self, view: VehicleView, fix: OwnFix | None, station: HeardStation | None) -> str:
        """What keeps the vehicle on the ground, or ''."""
        why = not_ready(self.plan, self.own, view, fix, self.navigator) or self.other_plan(station)
        return why or self._unanswered()

    def _unanswered(self) -> str:
        asked = [peer.id for peer in self.peers if peer.clock.unknown_s is not None]
        return (
            f"{agents_named(asked)} is heard and has not answered yet: its clock is not known"
            if asked
            else ""
        )

    def disagrees(self, view: VehicleView, fix: OwnFix) -> str:
        """Why the vehicle's two positions can't both be true, or ''."""
        return _disagreement(view, fix, self.navigator)

    def other_plan(self, station: HeardStation | None) -> str:
        """Who is not heard, or has another plan; ''."""
        if station is None and self.expect_station:
            return "no ground station heard yet"
        hashes = [(f"agent {p.id}", p.state.plan_hash) for p in self.peers if p.state is not None]
        if station is not None:
            hashes.append((f"station {station[0].station}", station[0].plan_hash))
        for who, plan_hash in hashes:
            if plan_hash != self.plan_hash:
                return f"{who} has another plan ({plan_hash:016x}, ours is {self.plan_hash:016x})"
        return ""


def not_ready(
    plan: Plan, own: AgentPlan, view: VehicleView, fix: OwnFix | None, navigator: Navigator
) -> str:
    """What keeps the vehicle of the agent `own` from taking off, or ''."""
    if not view.healthy or fix is None:
        return view.health_reason or "no position yet"
    unit = plan.unit_m
    off = math.dist((own.start[0] * unit, own.start[1] * unit), fix.position_ned_m[:2])
    if off > unit:
        return f"the vehicle stands {off:.1f} m from its planned start; allowed: {unit:g} m"
    apart = _disagreement(view, fix, navigator)
    if apart:
        return apart
    reserve = plan.policies.battery_reserve_percent
    if view.battery_percent is not None and view.battery_percent < reserve:
        return f"battery at {view.battery_percent:.0f} %; allowed: the reserve of {reserve:g} % and more"
    return ""


def _disagreement(view: VehicleView, fix: OwnFix, navigator: Navigator) -> str:
    apart = navigator.disagreement_m(view, fix)
    return (
        f"global and local position differ by {apart:.1f} m; allowed: {AGREE_M:g} m"
        if apart > AGREE_M
        else ""
    )
