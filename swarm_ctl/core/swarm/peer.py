"""One other agent as this one hears it: its newest state, how old that is, what was lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from swarm_ctl.core.model.histogram import Histogram
from swarm_ctl.core.model.messages import AgentState, LinkReport
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.core.swarm.clocks import PeerClock

_AGE_BIN_S = 0.01


@dataclass(slots=True)
class Peer:
    """One other agent of the plan as this one hears it."""

    id: int
    clock: PeerClock
    state: AgentState | None = None
    received_s: float = -math.inf
    received: int = 0
    lost: int = 0
    ages: Histogram = field(default_factory=lambda: Histogram(_AGE_BIN_S))
    stop_point: complex = 0j
    """Of the newest state, as is `commanded`; north + 1j * east [m, m/s]."""
    commanded: complex = 0j
    true_s: float = math.inf
    """On the own clock: when the state was true, by the best guess; and at the earliest."""
    earliest_s: float = math.inf

    def age(self, now: float) -> float:
        """Seconds since the state was true, not negative: right but for half the round trip."""
        return math.inf if self.state is None else now - self.true_s

    def age_at_most(self, now: float) -> float:
        """The same with all doubt against it: never more than twice `age` where the clock is
        known."""
        return math.inf if self.state is None else now - self.earliest_s

    def hear(self, state: AgentState, received_s: float) -> None:
        """Newest wins: what is older than what is known is dropped; gaps in `seq` count as lost."""
        self.clock.told(state.time_s, received_s)
        old = self.state
        if old is not None:
            # a late message is behind in both, and has a newer one behind it: else it is another
            # process, or its clock was set back
            late = state.time_s <= old.time_s and state.seq <= old.seq
            if late and received_s - self.received_s <= NEIGHBOUR_S:
                return
            if state.seq > old.seq:
                self.lost += state.seq - old.seq - 1
        before_s = self.true_s
        self._date(state.time_s, received_s)
        if old is not None and state.time_s < old.time_s and self.true_s < before_s:
            self.clock.forget(state.time_s, received_s)  # and has not answered since
            self._date(state.time_s, received_s)
        self.state, self.received_s = state, received_s
        self.stop_point, self.commanded = (
            complex(*state.stop_point_m),
            complex(*state.commanded_mps),
        )
        self.received += 1

    def _date(self, told_s: float, received_s: float) -> None:
        low, high = self.clock.bounds(received_s)
        self.true_s = min(told_s - 0.5 * (low + high), received_s)
        self.earliest_s = min(told_s - high, received_s)
        if (
            self.clock.unknown_s is not None
        ):  # heard, but from when? Not fresh, and lost if that lasts
            self.true_s = self.earliest_s = self.clock.unknown_s - 1.01 * NEIGHBOUR_S

    def report(self, now: float) -> LinkReport:
        """The link so far."""
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
