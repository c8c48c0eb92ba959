"""How well one sender's numbered messages arrive: age, loss, rate. Mission time throughout."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, islice
from operator import attrgetter
from typing import Final

from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.core.swarm.clocks import PeerClock
from swarm_ctl.station.picture.view import Reception

WINDOW_S: Final = 10.0
"""Long enough for a p99 at 20 Hz, short enough that a bad link shows while it is bad."""
_RATE_S: Final = 4.0
"""A rate over less would be that of one late tick."""
_MAX_TRANSIT_S: Final = 1.0
"""Before a sender's clock is known, one that is further off than this is not believed: age counts
from the receipt."""
_MOST_MISSING: Final = 200
"""Ten seconds at 20 Hz; nothing comes later than that."""


@dataclass(frozen=True, slots=True)
class _Arrival:
    received_s: float
    sent_s: float
    seq: int
    replaced_age_s: float
    """How old the message before had become."""
    lost: int
    """Missing between the message before and this one."""


_REPLACED: Final = attrgetter("replaced_age_s")
_LOST: Final = attrgetter("lost")


class Receiver:
    """Counts one sender's messages."""

    def __init__(self) -> None:
        self._window: deque[_Arrival] = deque()
        self._last: _Arrival | None = None
        self._clock = PeerClock()
        self._missing: set[int] = set()
        self._received = self._lost = self._late = self._restarts = 0

    def hear(self, seq: int, sent_s: float, received_s: float) -> bool:
        """Count a message; False where it is not newer than what is known already."""
        last = self._last
        back = last is not None and sent_s <= last.sent_s
        if back and last is not None and self._is_new_process(seq, received_s, last):
            self._clock.forget(sent_s, received_s)
            back = False
        self._clock.told(sent_s, received_s)
        if back:
            self._late += 1
            if seq in self._missing:  # late, not lost
                self._missing.remove(seq)
                self._lost -= 1
                self._received += 1
            return False
        lost = 0
        if last is not None and seq > last.seq:
            lost = seq - last.seq - 1
            self._miss(last.seq + 1, seq)
        elif last is not None:
            self._restarts += 1
            self._window.clear()
            self._missing.clear()
        age = self._age(received_s)
        self._last = _Arrival(received_s, sent_s, seq, 0.0 if age is None else age, lost)
        self._window.append(self._last)
        self._received += 1
        self._lost += lost
        self._forget(received_s)
        return True

    @staticmethod
    def _is_new_process(seq: int, received_s: float, last: _Arrival) -> bool:
        """Behind in number, after a silence: it counts anew, by a clock that may be behind, too."""
        return seq <= last.seq and received_s - last.received_s > NEIGHBOUR_S

    def answered(self, asked_s: float, heard_s: float, told_s: float, received_s: float) -> None:
        """Something of ours came back: as `PeerClock.answered`."""
        self._clock.answered(asked_s, heard_s, told_s, received_s)

    def report(self, now_s: float) -> Reception:
        """The reception at `now_s`."""
        self._forget(now_s)
        ages = sorted(map(_REPLACED, islice(self._window, 1, None)))
        lost = sum(map(_LOST, islice(self._window, 1, None)))
        return Reception(
            age_s=self._age(now_s),
            age_p50_s=_quantile(ages, 0.5),
            age_p99_s=_quantile(ages, 0.99),
            received=self._received,
            lost=self._lost,
            late=self._late,
            restarts=self._restarts,
            recent_loss=lost / (len(ages) + lost) if ages else 0.0,
            tick_rate_hz=self._rate(),
            clock_ahead_s=self.ahead(now_s),
        )

    def _age(self, now_s: float) -> float | None:
        if self._last is None:
            return None
        ahead = self.ahead(self._last.received_s)
        transit = self._last.received_s - self._last.sent_s + (ahead or 0.0)
        if ahead is None and transit > _MAX_TRANSIT_S:
            transit = 0.0
        return max(0.0, now_s - self._last.received_s) + max(0.0, transit)

    def ahead(self, now_s: float) -> float | None:
        """The sender's clock less this station's; as long as they may be one clock (on one host
        they are) they are."""
        low, high = self._clock.bounds(now_s)
        if not self._clock.known:
            return None
        return 0.0 if low <= 0.0 <= high else 0.5 * (low + high)

    def _rate(self) -> float | None:
        first, last = (self._window[0], self._window[-1]) if self._window else (None, None)
        if first is None or last is None or last.sent_s - first.sent_s < _RATE_S:
            return None
        return (last.seq - first.seq) / (last.sent_s - first.sent_s)

    def _miss(self, first: int, after: int) -> None:
        """Remember which are missing; of a long silence only the last."""
        if first == after and not self._missing:
            return
        self._missing = {seq for seq in self._missing if seq >= after - _MOST_MISSING}
        self._missing |= set(range(max(first, after - _MOST_MISSING), after))

    def _forget(self, now_s: float) -> None:
        while self._window and self._window[0].received_s < now_s - WINDOW_S:
            self._window.popleft()


def _quantile(ordered: Sequence[float], share: float) -> float | None:
    """The age that is not exceeded for `share` of the time: an age reached counts as long as it
    took to reach it."""
    passed = list(accumulate(ordered))
    return ordered[bisect_left(passed, share * passed[-1])] if passed else None
