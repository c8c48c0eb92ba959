"""What can be true of a peer's word: by itself, and after the word that was believed last.

A message may be forged, or its sender may be broken. What no vehicle of the plan can do is not
believed (`core/swarm/peers.py` says what is done instead). An honest vehicle can jump, too: its
estimate was corrected. The limits leave room for that.

Plain floats, because this runs for each state that is heard. Lengths in m, times in s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

from swarm_ctl.core.kernel.response import LATEST_S, stop_distance
from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.swarm.in_plan import InPlan

JUMP_M: Final = 2.0
"""A position may jump by this much on top of what was flown, and a stop point too: what estimates
are corrected by. Jumps add up, less `_FORGIVEN_MPS`."""
_FORGIVEN_MPS: Final = 2.0
INSISTS_S: Final = 0.4
"""A peer that says for so long what was not believed, and nothing else, is believed again: its
estimate was corrected, or its clock was set. Less than `FRESH_S`, so it is followed all the
while."""
SUSPECT_S: Final = 5.0
"""For so long after a word that was not believed, its sender is not counted on."""
CLOCK_S: Final = 1.0
"""A clock that steps by more is named."""
LASTS_S: Final = 1.0
"""A peer's word that ends its part in the mission, or pauses it, counts after so long without
another one between: one forged state lands no agent."""
_FARTHEST_M: Final = 1e5
"""Beyond every fence, and near enough that no sum or square of such coordinates overflows."""
_SLOWEST_S: Final = 8.0
"""Dead time, lag, and what a mission file allows of both."""
_SLOWER_S: Final = 2.0
"""A peer that tells a response which is longer than the plan's by more than this slows the others
by no more than this: 1 s over the model is what keeps apart
(docs/understand/safety-evidence.md)."""
_SMALLEST: Final = 1e-3
"""Of a formation's scale."""
CREEP_M: Final = 3.0
"""By so much more than their velocities tell, places may have moved of late (`Creep`): a drift of
0.3 m/s is named after 14 s, one of under 0.15 m/s never. Real PX4s came to 1.3 m (square, hexagon,
crossing) and ArduCopters to 0.07 m, simulated vehicles under 0.5 m of GPS noise to 1.7 m, in all
other bad weather to 1.1 m."""
HEIGHT_JUMP_M: Final = 0.7
"""In `_CREPT_OVER_S`: more than a climb that changes its rate between two words, and the noise of
heights, make up."""
_CREPT_S: Final = 20.0
"""Of late."""
_CREPT_OVER_S: Final = 1.0
_CREPT_AT_MOST_M: Final = 1.0
"""Of one such time: an estimate that is corrected moves its vehicle once, and drifts no farther."""
_CREPT_GAP_S: Final = 0.6
"""Two states that are farther apart do not tell how the vehicle flew between them."""
_ROUNDING: Final = 1.05
"""Speeds that agents keep to are told in 32 bits, and filtered to a tolerance."""


class Doubt(StrEnum):
    """What was not believed."""

    CREEP = "creep"
    """Places that move otherwise than the velocities tell."""
    FIGURE = "figure"
    """A number that no vehicle of this plan can have."""
    PLACE = "place"
    """A position, or a stop point, that is too far from the one before."""
    CLOCK = "clock"
    SENDERS = "senders"
    """Two senders speak as one agent."""
    FRAME = "frame"
    """A frame of the formation that its step does not have."""
    HEIGHT = "height"
    """Heights that move otherwise than the climb rates tell."""
    SENSOR = "sensor"
    """The traffic sensor sees the vehicle stop elsewhere."""


class Suspicion(NamedTuple):
    """Why a word is not believed."""

    doubt: Doubt
    words: str


class Jumps(NamedTuple):
    """By how much a track's points have jumped of late [m]."""

    place_m: float = 0.0
    stop_m: float = 0.0


NO_JUMPS: Final = Jumps()


@dataclass(frozen=True, slots=True)
class BeliefLimits:
    """What vehicles of one plan can do."""

    fastest_mps: float
    """Of a vehicle that is blown away."""
    moves_mps: float
    """Of positions and stop points: the fastest that the mission allows, or a gust."""
    setpoint_mps: float
    response_s: float
    """The longest that is counted with."""
    stops_m: float
    """From full speed, once zero acts."""
    in_plan: InPlan
    """What can be named."""
    heights: bool
    """The slots have heights, so that these are looked at."""

    @classmethod
    def of(cls, plan: Plan) -> BeliefLimits:
        """For this plan."""
        response, speed_mps = plan.response, plan.limits.speed_mps
        moves = max(plan.policies.max_speed_mps, 2.0 * speed_mps)
        slowest = response.dead_time_s + response.lag_s + _SLOWER_S
        stops = stop_distance(moves, response)
        high = plan.wake is not None
        return cls(2.0 * moves, moves, _ROUNDING * speed_mps, slowest, stops, InPlan(plan), high)

    def counted_s(self, response_s: float) -> float:
        """The response that is counted with, of a peer that tells this one."""
        return min(response_s, self.response_s)

    def absurd(self, state: AgentState) -> Suspicion | None:
        """What of this state, by itself, no vehicle of the plan can do, or the plan has not."""
        unknown = self.in_plan.of_state(state)
        if unknown:
            return Suspicion(Doubt.FIGURE, unknown)
        (north, east, down), (stop_n, stop_e) = state.position_ned_m, state.stop_point_m
        most = _FARTHEST_M
        if not (
            -most <= north <= most
            and -most <= east <= most
            and -most <= down <= most
            and -most <= stop_n <= most
            and -most <= stop_e <= most
        ):
            return Suspicion(Doubt.FIGURE, f"it is more than {_FARTHEST_M / 1000:g} km away")
        (v_north, v_east, _), (told_n, told_e) = state.velocity_ned_mps, state.setpoint_mps
        flown, told = math.hypot(v_north, v_east), math.hypot(told_n, told_e)
        if flown > self.fastest_mps:
            return _over("it flies at", flown, self.fastest_mps, "m/s")
        if told > self.setpoint_mps:
            return _over("its setpoint is", told, self.setpoint_mps, "m/s")
        response_s = state.response_s
        if not -LATEST_S <= response_s <= _SLOWEST_S or not 0 <= state.doubt_s <= _SLOWEST_S:
            return _over("it answers after", response_s, _SLOWEST_S, "s")
        ahead = math.hypot(stop_n - north, stop_e - east)
        reach = max(0.0, self.counted_s(response_s)) * max(flown, self.setpoint_mps)
        reach += self.stops_m + JUMP_M
        if ahead > reach:
            return _over("its stop point is ahead of it by", ahead, reach, "m")
        frame = state.frame
        if frame is not None and not 0 <= frame.rate <= _ROUNDING:
            return _over("its formation moves at", frame.rate, 1.0, "of its speed")
        if frame is not None and not _SMALLEST <= frame.scale <= 1e3:
            words = f"its formation has the scale {frame.scale:.3g}; allowed: {_SMALLEST:g} to 1000"
            return Suspicion(Doubt.FIGURE, words)
        return None

    def jump(
        self, before: AgentState, state: AgentState, elapsed_s: float, jumps: Jumps
    ) -> tuple[Suspicion | None, Jumps]:
        """Whether the vehicle can have come from the one state to the other in `elapsed_s`; the
        jumps so far."""
        forgiven = _FORGIVEN_MPS * elapsed_s
        flown = self.moves_mps * elapsed_s
        (old_n, old_e, _), (north, east, _) = before.position_ned_m, state.position_ned_m
        place_m = math.hypot(north - old_n, east - old_e) - flown
        stop_m = math.dist(before.stop_point_m, state.stop_point_m) - flown
        if jumps == NO_JUMPS and forgiven >= 0.0 >= max(place_m, stop_m):
            return None, NO_JUMPS  # as nearly always
        new = Jumps(
            max(0.0, jumps.place_m - forgiven) + max(0.0, place_m),
            max(0.0, jumps.stop_m - forgiven) + max(0.0, stop_m),
        )
        for what, beyond_m, told_m in (
            ("it", new.place_m, place_m + flown),
            ("its stop point", new.stop_m, stop_m + flown),
        ):
            if beyond_m > JUMP_M:
                words = f"{what} jumped by {told_m:.1f} m in {elapsed_s:.2f} s"
                allowed = f"{flown + JUMP_M:.1f} m"
                if told_m <= flown + JUMP_M:  # many small ones
                    words, allowed = f"{what} jumped by {beyond_m:.1f} m in all", f"{JUMP_M:g} m"
                return Suspicion(Doubt.PLACE, f"{words}; allowed: {allowed}"), jumps
        return None, new


class Creep:
    """How far the places that one peer tells have moved away from where its velocities lead: a
    place that is told wrong by a slow drift makes no jump."""

    def __init__(self) -> None:
        self._off = self._new = 0j
        self._for_s = 0.0
        self._crept = False

    def look(self, before: AgentState, state: AgentState) -> Suspicion | None:
        """Whether they have moved too far, with the state that follows `before`."""
        elapsed_s = state.time_s - before.time_s
        if not 0.0 < elapsed_s <= _CREPT_GAP_S:
            return self._found()
        old_n, old_e, _ = before.position_ned_m
        north, east, _ = state.position_ned_m
        was_n, was_e, _ = before.velocity_ned_mps
        now_n, now_e, _ = state.velocity_ned_mps
        half_s = 0.5 * elapsed_s
        self._new += complex(
            north - old_n - half_s * (was_n + now_n), east - old_e - half_s * (was_e + now_e)
        )
        self._for_s += elapsed_s
        if self._for_s < _CREPT_OVER_S:
            return self._found() if self._crept else None
        counted = self._new * min(1.0, _CREPT_AT_MOST_M / max(abs(self._new), 1e-9))
        self._off = self._off * math.exp(-self._for_s / _CREPT_S) + counted
        self._crept = abs(self._off) > CREEP_M
        self._new, self._for_s = 0j, 0.0
        return self._found()

    def _found(self) -> Suspicion | None:
        if not self._crept:
            return None
        words = f"its places drift: {abs(self._off):.1f} m from where its velocities lead"
        return Suspicion(Doubt.CREEP, f"{words}; allowed: {CREEP_M:g} m")


class HeightJumps:
    """How far heights have jumped away from where climb rates lead: of a peer's words, or of the
    own estimate. An estimate that has jumped once is off by that, before or after it."""

    def __init__(self) -> None:
        self.off_m = 0.0
        """All jumps together."""
        self._new_m = self._for_s = 0.0

    def look(self, elapsed_s: float, climbed_m: float, climb_mps: float) -> float:
        """The jump that has become plain now [m], or 0.

        Args:
            elapsed_s: since the last height.
            climbed_m: from that one to this one.
            climb_mps: the mean of both climb rates.
        """
        if not 0.0 < elapsed_s <= _CREPT_GAP_S:
            self._new_m = self._for_s = 0.0
            return 0.0
        self._new_m += climbed_m - climb_mps * elapsed_s
        self._for_s += elapsed_s
        jumped = abs(self._new_m) > HEIGHT_JUMP_M
        if not jumped and self._for_s < _CREPT_OVER_S:
            return 0.0
        found = self._new_m if jumped else 0.0
        self.off_m += found
        self._new_m = self._for_s = 0.0
        return found


def _over(what: str, value: float, most: float, unit: str) -> Suspicion:
    return Suspicion(Doubt.FIGURE, f"{what} {value:.3g} {unit}; allowed: {most:.3g} {unit}")
