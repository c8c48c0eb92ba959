"""Whether a vehicle on the ground may take part: healthy, at its planned start, and all agents with
the same plan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.agent.tick import HeardStation, Tick
from swarm_ctl.core.control.navigation import AGREE_M, Navigator
from swarm_ctl.core.law.own_response import OwnResponse
from swarm_ctl.core.model.plan import AgentPlan, Plan, Policies, Policy, Response
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.model.timeouts import ESTIMATE_DOUBT_S, KEYS_VALID_S
from swarm_ctl.core.model.vehicle import LimitKind, VehicleView
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

_SURE_S: Final = 0.1
"""An estimate of the response is sure that is doubted by no more: after a second at 2 m/s."""
_MODEL_SPARE: Final = 0.1
"""The acceleration of a measured response is good to so much."""


@dataclass(frozen=True, slots=True)
class Preflight:
    """What one agent has to see before it arms.

    `expect_station`: the agent was started with a ground station, so it does not arm before it
    hears one.
    """

    plan: Plan
    own: AgentPlan
    plan_hash: int
    navigator: Navigator
    expect_station: bool
    response: Response
    """How the law expects the own vehicle to answer a setpoint."""
    keys_end_s: float = math.inf
    """When the own certificate ends, on the own clock."""

    def refusal(self, tick: Tick) -> str:
        """What keeps the vehicle on the ground, or ''."""
        unheard = self.expect_station and tick.station is None
        why = self._vehicle(tick) or self._keys(tick.now)
        why = why or ("no ground station heard yet" if unheard else "")
        return why or self.other_plan(tick.peers, tick.station) or _unsure_of(tick.peers)

    def other_plan(self, peers: PeerSnapshot, station: HeardStation | None) -> str:
        """The peer or station that has another plan, or ''."""
        plans = [(f"agent {p.id}", p.state.plan_hash) for p in peers.peers if p.state is not None]
        if station is not None:
            plans.append((f"station {station[0].station}", station[0].plan_hash))
        for name, plan_hash in plans:
            if plan_hash != self.plan_hash:
                return f"{name} has another plan ({plan_hash:016x}, ours is {self.plan_hash:016x})"
        return ""

    def disagreement(self, tick: Tick) -> str:
        """Why the vehicle's two positions cannot both be true, or ''."""
        fix = tick.fix
        apart = self.navigator.disagreement_m(tick.view, fix) if fix is not None else 0.0
        if apart <= AGREE_M:
            return ""
        return f"global and local position differ by {apart:.1f} m; allowed: {AGREE_M:g} m"

    def caution(self, tick: Tick) -> str:
        """What the operator should know before the vehicle arms, although it may; ''.

        A wind limit that the mission does not state is no news: no vehicle as delivered estimates
        the wind."""
        policies, usual, cautions = self.plan.policies, Policies(), []
        chosen = (policies.wind, policies.wind_limit_mps) != (usual.wind, usual.wind_limit_mps)
        if tick.view.battery_percent is None and policies.battery_low is not Policy.CONTINUE:
            reserve = policies.battery_reserve_percent
            cautions.append(
                f"the vehicle does not say its charge: the reserve of {reserve:g} % can't act"
            )
        acts = policies.wind is not Policy.CONTINUE
        if chosen and acts and not tick.view.estimates_wind:
            limit = policies.wind_limit_mps
            cautions.append(
                f"the vehicle does not estimate the wind: the limit of {limit:g} m/s can't act; the"
                f" tilt limit ({policies.max_tilt_deg:g} degrees) does"
            )
        return "; ".join(cautions)

    def too_slow(self, view: VehicleView) -> str:
        """Where the mission asks for more than the vehicle's own limits allow, or ''."""
        if view.unread_limits:
            return f"parameters not read yet: {', '.join(view.unread_limits)}"
        limits = self.plan.limits
        flown = {
            LimitKind.SPEED: limits.speed_mps,
            LimitKind.CLIMB: limits.climb_mps,
            LimitKind.DESCENT: limits.descent_mps,
            LimitKind.ACCELERATION: self.response.acceleration_mps2,
        }
        for limit in view.limits:
            acceleration = limit.kind is LimitKind.ACCELERATION
            least = flown[limit.kind] * (1 - _MODEL_SPARE if acceleration else 1)
            if limit.allowed < least - 1e-6:
                what = f"the {'law expects that it' if acceleration else 'mission'} {limit.kind}"
                unit = f"m/s{'2' * acceleration}"
                allows = f"vehicle {self.own.id} allows {limit.allowed:.1f} ({limit.parameter})"
                return f"{what} {flown[limit.kind]:.1f} {unit}; {allows}"
        return ""

    def _keys(self, now: float) -> str:
        """A certificate that ends soon; no flight ends with it. Or ''."""
        left_s = self.keys_end_s - now
        if left_s >= KEYS_VALID_S:
            return ""
        ends = f"ends in {left_s / 3600:.0f} h" if left_s > 0 else "has ended"
        return f"its certificate {ends}; allowed: 24 h and more (swarm-ctl trust rotate)"

    def _vehicle(self, tick: Tick) -> str:
        """What keeps the own vehicle from taking off, or ''."""
        view, fix, unit = tick.view, tick.fix, self.plan.unit_m
        if not view.healthy or fix is None:
            return view.health_reason or "no position yet"
        start = (self.own.start[0] * unit, self.own.start[1] * unit)
        off = math.dist(start, fix.position_ned_m[:2])
        if off > unit:
            return f"the vehicle stands {off:.1f} m from its planned start; allowed: {unit:g} m"
        apart = self.disagreement(tick)
        doubt = apart or view.doubt(self.plan.policies.position_accuracy_m)
        if doubt:
            return doubt
        slow = self.too_slow(view)
        if slow:
            return slow
        left, reserve = view.battery_percent, self.plan.policies.battery_reserve_percent
        if left is not None and left < reserve:
            return f"battery at {left:.0f} %; allowed: the reserve of {reserve:g} % and more"
        return ""


class EstimateWatch:
    """What a vehicle says against its own estimate in the air, if it lasts."""

    def __init__(self, accuracy_m: float) -> None:
        self._accuracy_m = accuracy_m
        self._text = ""
        self._since_s = self._last_s = -math.inf

    def look(self, now: float, view: VehicleView) -> str:
        """The doubt as it was first said, once it has lasted for `ESTIMATE_DOUBT_S` and until it
        has been gone for as long; ''."""
        found = view.doubt(self._accuracy_m)
        if found:
            self._last_s = now
            if not self._text:
                self._text, self._since_s = found, now
        elif now - self._last_s >= ESTIMATE_DOUBT_S:
            self._text = ""
        return self._text if self._last_s - self._since_s >= ESTIMATE_DOUBT_S else ""


class ResponseWatch:
    """What the flight says against how the vehicle is believed to answer; said once.

    The stop point follows the estimate. But the margins at the start of each flight follow the
    response, so its owner has to know.
    """

    def __init__(self, response: Response) -> None:
        self._known_s, self._said = response.doubt_s, False

    def look(self, estimate: OwnResponse) -> str:
        """The warning, once the estimate is sure; '' before, and from then on."""
        late_s, doubt_s = estimate.late_s, estimate.doubt_s
        if self._said or doubt_s > _SURE_S or abs(late_s) <= self._known_s + doubt_s:
            return ""
        self._said = True
        return (
            f"the vehicle answers {abs(late_s):.2f} s {'later' if late_s > 0 else 'earlier'} than"
            f" its response says, which is known to {self._known_s:g} s: measure it"
            " (swarm-ctl measure)"
        )


def swarm_flies(peers: PeerSnapshot) -> str:
    """The peer by whose newest word the first step is over, or ''. No agent takes off after it:
    one that was started again beside its landed vehicle would do so alone."""
    for peer in peers.peers:
        if peer.state is not None and peer.state.step > 1:
            return f"the swarm flies already: agent {peer.id} is in step {peer.state.step}"
    return ""


def _unsure_of(peers: PeerSnapshot) -> str:
    suspect = [peer.id for peer in peers.peers if peer.suspect]
    if suspect:
        return f"{agents_named(suspect)} is not believed: see the log"
    asked = [peer.id for peer in peers.peers if peer.clock_unknown]
    if not asked:
        return ""
    return f"{agents_named(asked)} is heard and has not answered yet: its clock is not known"
