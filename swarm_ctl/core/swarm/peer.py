"""One peer as this agent hears it: its newest state, how old that is, what was lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from swarm_ctl.core.model.histogram import Histogram
from swarm_ctl.core.model.messages import AgentState, LinkReport, Phase
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.swarm.clocks import PeerClock
from swarm_ctl.core.swarm.snapshot import OtherAircraft

_AGE_BIN_S = 0.01
_YIELDING = frozenset({Phase.FLY, Phase.HOLD, Phase.RETURN})
"""A peer in these phases flies by setpoints, so it keeps apart itself."""


@dataclass(slots=True)
class Peer:
    """What this agent has heard of one other agent of the plan."""

    id: int
    clock: PeerClock
    state: AgentState | None = None
    received_s: float = -math.inf
    received: int = 0
    lost: int = 0
    ages: Histogram = field(default_factory=lambda: Histogram(_AGE_BIN_S))
    true_s: float = math.inf
    """When the state was true, on the own clock, by the best guess."""
    earliest_s: float = math.inf
    """The same, at the earliest."""

    def age(self, now: float) -> float:
        """Seconds since the state was true, not negative: right but for half the round trip."""
        return math.inf if self.state is None else now - self.true_s

    def view(self, now: float) -> OtherAircraft:
        """This peer at one tick. Never heard: no state, infinite age."""
        state = self.state
        if state is None:
            return OtherAircraft(self.id, clock_unknown=self.clock.unknown_s is not None)
        age_s = now - self.true_s
        fresh = age_s <= FRESH_S
        return OtherAircraft(
            self.id,
            state,
            complex(state.position_ned_m[0], state.position_ned_m[1]),
            complex(*state.stop_point_m),
            complex(*state.setpoint_mps),
            age_s,
            now - self.earliest_s,
            fresh,
            age_s <= NEIGHBOUR_S,
            fresh and state.phase in _YIELDING,
            (state.step, state.override) if fresh and state.phase is Phase.FLY else None,
            state.response_s,
            self.clock.unknown_s is not None,
        )

    def hear(self, state: AgentState, received_s: float) -> None:
        """Newest wins: what is older than what is known is dropped; gaps in `seq` count as lost."""
        self.clock.told(state.time_s, received_s)
        old = self.state
        if old is not None:
            # A late message is behind in time and number, and a newer one came just before. One
            # that is behind and comes alone is from another process, or its clock was set back.
            late = state.time_s <= old.time_s and state.seq <= old.seq
            if late and received_s - self.received_s <= NEIGHBOUR_S:
                return
            if state.seq > old.seq:
                self.lost += state.seq - old.seq - 1
        before_s = self.true_s
        self._date(state.time_s, received_s)
        if old is not None and state.time_s < old.time_s and self.true_s < before_s:
            self.clock.forget(state.time_s, received_s)  # it has not answered since
            self._date(state.time_s, received_s)
        self.state, self.received_s = state, received_s
        self.received += 1

    def _date(self, told_s: float, received_s: float) -> None:
        low, high = self.clock.bounds(received_s)
        self.true_s = min(told_s - 0.5 * (low + high), received_s)
        self.earliest_s = min(told_s - high, received_s)
        if self.clock.unknown_s is not None:
            # how old its states are is not known: not fresh, and lost if that lasts
            self.true_s = self.earliest_s = self.clock.unknown_s - 1.01 * NEIGHBOUR_S

    def report(self, now: float) -> LinkReport:
        """The mesh link from this peer over the whole run."""
        age, (low, high) = self.age(now), self.clock.bounds(now)
        return LinkReport(
            None if math.isinf(age) else age,
            self.ages.percentile(0.5),
            self.ages.percentile(0.99),
            self.received,
            self.lost,
            round(0.5 * (low + high), 6) if self.clock.known else None,
            round(high - low, 6) if self.clock.known else None,
        )
