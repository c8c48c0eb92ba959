"""Which aircraft one agent is apart from by height, and whether it may fly on through the heights
of others.

In a mission whose slots have heights (`Plan.wake`) each agent tells the height that it flies to. A
pair whose spans (`core/kernel/heights.py`) lie far enough from each other has no plane between
them; each other pair counts as in one plane, as in any mission. So a pair of which one is to pass
the other's height keeps apart in the plane before it does, while it does, and until it has.

Horizontal vectors are north + 1j * east [m]; heights are m above the common frame's origin.
"""

from __future__ import annotations

from dataclasses import replace

from swarm_ctl.core.kernel.constraints import Margins, Other, keep_out
from swarm_ctl.core.kernel.heights import (
    NO_SPAN,
    Span,
    apart_by_height,
    is_ahead,
    may_pass,
    needed_m,
    span,
)
from swarm_ctl.core.model.plan import HEIGHT_DOUBT_M, Plan
from swarm_ctl.core.swarm.plausibility import HeightJumps
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot


class Layers:
    """One agent's view of heights, tick by tick."""

    def __init__(self, plan: Plan, own_id: int, margins: Margins) -> None:
        limits = plan.limits
        self._flown = plan.wake is not None
        self._layer_m = plan.layer_m
        self._closing_mps = limits.climb_mps + limits.descent_mps
        self._r_in_m = plan.law.r_in * plan.unit_m
        self._own, self._margins = own_id, margins
        self._jumps = HeightJumps()
        self._last: tuple[float, float, float] | None = None
        self.waits_for: int | None = None
        """The aircraft whose height is to be passed, and which is too near for that; `TRAFFIC`: one
        that no peer explains. None: nothing is."""

    def locate(self, now: float, height_m: float, climb_mps: float) -> None:
        """The own height, and how fast it rises, by the own estimate at `now`; call it every
        tick."""
        if self._flown and self._last is not None:
            then, last_m, last_mps = self._last
            self._jumps.look(now - then, height_m - last_m, 0.5 * (last_mps + climb_mps))
        self._last = now, height_m, climb_mps

    def sorted(
        self, snapshot: PeerSnapshot, own: complex, height_m: float, climbs_m: float
    ) -> PeerSnapshot:
        """The snapshot, with those marked that the agent is apart from by height.

        `own` is the own stop point; the vehicle is at `height_m`, and is to climb by `climbs_m`
        (-inf: to the ground, wherever that is).
        """
        self.waits_for = None
        if not self._flown:
            return snapshot
        one = span(height_m, height_m + climbs_m, HEIGHT_DOUBT_M + abs(self._jumps.off_m))
        over = set[int]()
        for other in snapshot.peers:
            if other.state is None:
                continue
            told = self._span(other)
            age_s = other.age_at_most_s
            if apart_by_height(one, told, self._layer_m, self._closing_mps, age_s):
                over.add(other.id)
            elif self._is_blocked(other, one, told, own, height_m, climbs_m):
                self.waits_for = other.id
        for other in snapshot.traffic:
            if climbs_m and not self._has_room(other, own):
                self.waits_for = other.id
        return replace(snapshot, over=frozenset(over)) if over else snapshot

    def _span(self, other: OtherAircraft) -> Span:
        """Nothing is known of a peer whose word is late or doubted, or that does not fly by
        setpoints of its agent."""
        state = other.state
        if state is None or state.goal_height_m is None or not other.yields:
            return NO_SPAN
        doubt_m = HEIGHT_DOUBT_M + other.height_off_m
        return span(-state.position_ned_m[2], state.goal_height_m, doubt_m)

    def _is_blocked(
        self,
        other: OtherAircraft,
        one: Span,
        told: Span,
        own: complex,
        height_m: float,
        climbs_m: float,
    ) -> bool:
        """It is ahead in height, within reach of the way, and too near for passing it."""
        if other.state is None or other.down:
            return False
        age_s = other.age_at_most_s if other.yields else 0.0
        near_m = needed_m(one, told, self._layer_m, self._closing_mps, age_s)
        other_m = -other.state.position_ned_m[2]
        ahead = is_ahead(height_m, climbs_m, other_m, near_m)
        return ahead and not self._has_room(other, own)

    def _has_room(self, other: OtherAircraft, own: complex) -> bool:
        seen = Other(
            about=other.id,
            lower=self._own < other.id,
            apart=own - other.stop_point,
            setpoint=other.setpoint,
            age_s=other.age_at_most_s,
            fresh=other.fresh,
            yields=other.yields,
            response_s=other.response_s,
            along=False,
        )
        _, _, room = keep_out(seen, self._margins)
        return may_pass(room, self._margins.keep_out, self._r_in_m)
