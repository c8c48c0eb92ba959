"""An agent's account of itself: the status that goes out at 2 Hz, and what has to be counted for
it."""

from __future__ import annotations

import math
from collections.abc import Iterable

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.messages import (
    AgentState,
    AgentStatus,
    Echo,
    Phase,
    TickReport,
    VehicleLinkReport,
)
from swarm_ctl.core.model.vehicle import VehicleView
from swarm_ctl.core.swarm.peers import Peers


class StatusReport:
    """Counts setpoints; puts the status together."""

    def __init__(self) -> None:
        self._setpoints = 0
        self._first_s = self._last_s = 0.0

    def setpoint(self, now: float) -> None:
        """One was sent."""
        if self._setpoints == 0:
            self._first_s = now
        self._setpoints += 1
        self._last_s = now

    def status(
        self,
        now: float,
        view: VehicleView,
        peers: Peers,
        controller: Controller,
        progress: Progress,
        *,
        agent: int,
        phase: Phase,
        reason: str,
        outcome: str,
        height_m: float | None,
        formation_error_m: float | None,
        near: tuple[int | None, float | None],
        station_s: float | None,
        tick: TickReport,
        bad_payloads: int,
        echo: Echo | None,
        roles: tuple[tuple[float, int], ...],
    ) -> AgentStatus:
        """Everything about an agent that is not needed every tick."""
        span = self._last_s - self._first_s
        return AgentStatus(
            agent=agent,
            time_s=now,
            phase=phase,
            step=progress.step,
            done=progress.done,
            reason=reason,
            outcome=outcome,
            mode=view.mode,
            armed=view.armed,
            airborne=not view.on_ground,
            battery_percent=view.battery_percent,
            height_m=height_m,
            formation_error_m=formation_error_m,
            nearest_agent=near[0],
            nearest_m=near[1],
            heartbeat_age_s=now - view.heartbeat_s if math.isfinite(view.heartbeat_s) else None,
            station_age_s=None if station_s is None else now - station_s,
            setpoints=self._setpoints,
            setpoint_rate_hz=(self._setpoints - 1) / span if span > 0 else 0.0,
            neighbours=peers.neighbours(now),
            sigma_tally=controller.tally,
            overspeed_ticks=controller.overspeed_ticks,
            links={peer.id: peer.report(now) for peer in peers},
            steps=tuple(progress.results),
            tick=tick,
            bad_payloads=bad_payloads,
            vehicle_link=VehicleLinkReport(view.frames, view.frames_lost, view.round_trip_s),
            echo=echo,
            gains=controller.gains,
            safety=controller.keeper.report(),
            roles=roles,
        )


def nearest(others: Iterable[AgentState], fix: OwnFix | None) -> tuple[int | None, float | None]:
    """Who is nearest, and its horizontal distance [m]."""
    if fix is None:
        return None, None
    own = fix.position_ned_m
    gaps = [
        (math.hypot(own[0] - s.position_ned_m[0], own[1] - s.position_ned_m[1]), s.agent)
        for s in others
    ]
    if not gaps:
        return None, None
    distance, agent = min(gaps)
    return agent, distance
