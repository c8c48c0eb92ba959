"""An agent's account of itself: the status that goes out at 2 Hz."""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.core.agent.group import Group
from swarm_ctl.core.agent.interruption import Interruption
from swarm_ctl.core.agent.own_vehicle import OwnVehicle
from swarm_ctl.core.agent.steering import SetpointCount
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.model.messages import (
    AgentStatus,
    Departure,
    Echo,
    LinkReport,
    Phase,
    Refusal,
    RefusalReason,
    TickReport,
    VehicleLinkReport,
)
from swarm_ctl.core.model.vehicle import VehicleView
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

_SAID_AGAIN_S: Final = 10.0


def status_report(
    tick: Tick,
    agent: int,
    phase: Phase,
    reason: str,
    vehicle: OwnVehicle,
    group: Group,
    interruption: Interruption,
    controller: Controller,
    setpoints: SetpointCount,
    *,
    links: dict[int, LinkReport],
    loop: TickReport,
    bad_payloads: int,
    refused: tuple[Refusal, ...] = (),
    doubted: dict[int, str] | None = None,
    left: Departure | None = None,
) -> AgentStatus:
    """Everything about an agent that is not needed every tick.

    Args:
        tick: this tick.
        agent: its id.
        phase: what it does.
        reason: why it waits, holds or lands, or ''.
        vehicle: what has become of its vehicle.
        group: whom it flies with.
        interruption: what stops the mission.
        controller: its horizontal control.
        setpoints: sent so far.
        links: the mesh link from each peer.
        loop: the control loop's punctuality.
        bad_payloads: mesh messages that were refused for what they are, so far.
        refused: what was refused on the mesh in the last seconds.
        doubted: why, by peer of which a word was not believed of late.
        left: by which order this agent has left the formation.
    """
    view, fix, now, trigger = tick.view, tick.newest_fix, tick.now, interruption.trigger
    nearest_agent, nearest_m = _nearest(tick.peers, fix.position_ned_m if fix else None)
    station_s, echo = tick.station_s, None
    if tick.station is not None:
        beacon, received_s = tick.station
        echo = Echo(beacon.station, beacon.time_s, now - received_s)
    return AgentStatus(
        agent=agent,
        time_s=now,
        phase=phase,
        step=group.progress.step,
        done=group.progress.done,
        reason=reason,
        outcome=interruption.outcome,
        mode=view.mode,
        armed=view.armed,
        airborne=not view.on_ground,
        battery_percent=view.battery_percent,
        height_m=vehicle.height(fix) if fix is not None else None,
        formation_error_m=group.formation_error_m,
        nearest_agent=nearest_agent,
        nearest_m=nearest_m,
        heartbeat_age_s=now - view.heartbeat_s if math.isfinite(view.heartbeat_s) else None,
        station_age_s=None if station_s is None else now - station_s,
        setpoints=setpoints.count,
        setpoint_rate_hz=setpoints.rate_hz,
        neighbours=group.neighbourhood.heard(tick.peers),
        sigma_tally=controller.tally,
        overspeed_ticks=controller.overspeed_ticks,
        links=links,
        steps=tuple(group.progress.results),
        tick=loop,
        bad_payloads=bad_payloads,
        vehicle_link=_link_report(view),
        echo=echo,
        gains=controller.gains,
        zones=controller.other_zones,
        position_accuracy_m=view.position_accuracy_m,
        safety=controller.safety_filter.report(),
        roles=tuple(group.slot_exchange.taken),
        closings=tuple(group.closings),
        own=view.own,
        action=trigger.action if trigger else None,
        cause=trigger.cause if trigger else None,
        left=left,
        refused=refused,
        doubted=doubted or {},
        far_heard=sum(peer.far and peer.fresh for peer in tick.peers.peers),
        without=tuple(peer.id for peer in tick.peers.peers if peer.left is not None),
    )


def _link_report(view: VehicleView) -> VehicleLinkReport:
    heard = view.frames, view.frames_lost, view.round_trip_s
    return VehicleLinkReport(*heard, view.signed, view.refused, dict(view.refusals), view.unsafe)


class RefusalsSaid:
    """Which refusals the log has been told of: a new kind at once, newer ones after 10 s."""

    def __init__(self) -> None:
        self._said_s: dict[tuple[str, RefusalReason], float] = {}

    def due(self, refused: tuple[Refusal, ...], now: float) -> list[str]:
        """What is to be said now, of what was refused in the last seconds."""
        if not (refused or self._said_s):
            return []
        said = {key: at for key, at in self._said_s.items() if now - at < 2 * _SAID_AGAIN_S}
        before_s = {r: said.get((r.owner, r.reason), -math.inf) for r in refused}
        new = [r for r, at in before_s.items() if r.time_s > at and now - at >= _SAID_AGAIN_S]
        self._said_s = said | {(r.owner, r.reason): now for r in new}
        return [f"refused on the mesh: {r.words}" for r in new]


def _nearest(
    peers: PeerSnapshot, own: tuple[float, float, float] | None
) -> tuple[int | None, float | None]:
    """The nearest fresh peer, and its horizontal distance [m]."""
    states = peers.fresh()
    if own is None or not states:
        return None, None
    gaps = [
        (math.hypot(own[0] - s.position_ned_m[0], own[1] - s.position_ned_m[1]), s.agent)
        for s in states
    ]
    distance, agent = min(gaps)
    return agent, distance
