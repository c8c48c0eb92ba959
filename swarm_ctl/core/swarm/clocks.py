"""How far the peers' clocks are ahead of the own one, and how well that is known.

Each agent says once a second what its clock shows (`ClockNews`), and gives each peer's newest word
back with the time that it has held it. A word that left here at t1, came to the peer at t2, was
given back at t3 (both by its clock) and came here at t4 bounds how far the peer's clock is ahead:

    t3 - t4 <= ahead <= t2 - t1

The middle is NTP's offset, the width its round trip (RFC 5905, section 8), so the middle is off by
at most half the round trip, however unequal the two ways are. The two bounds are kept apart, each
the best that was found: the fastest way there and the fastest way back need not be one round trip,
and each state that is heard is a way back, too. An old bound loosens by `DRIFT` a second, so a
newer one replaces it without any window.

Ages are counted with the bound that makes a message older (`Peer.view`). A clock that jumps, or
drifts more, contradicts its bounds. One word that does so may be forged, so it changes nothing:
words that agree with each other do, after `STEADY_S`, unless one that agrees with the bounds comes
between. While a clock is not known, its agent's states are not fresh, and the agent is not lost at
once.

Agents that a launcher starts on one host share one clock (`SharedClock`): they know it exactly, and
say no words to each other.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from typing import Final

from swarm_ctl.core.model.messages import Answers, ClockEcho, ClockNews

DRIFT: Final = 1e-3
"""[s/s] Between two clocks: 50 ppm each for bad crystals, 500 ppm while NTP slews one of them (the
kernel's most), and a margin. It costs 1 ms a second until the next word."""
EVERY_S: Final = 1.0
"""Between two words. Four in a row may be lost before the bounds are as wide as one lost state."""
ASK_EVERY_S: Final = 0.2
"""While an agent hears a peer whose clock it does not know: at the start, and after a jump. With
half of all words lost it mostly knows the clock after half a second; it has four."""
STEADY_S: Final = 0.4
"""Words at the rate of `ASK_EVERY_S` say so three times in this time; a forger's are contradicted
by the states, which come at 20 Hz."""
_LATE_S: Final = 0.5
"""A state that is later than this does not say how the clock stands."""
_OTHER_S: Final = 1.0
"""A shared clock is another one once all states of so long were late."""
_ECHOED_S: Final = 5.0
"""Words of a peer that has been silent for longer are not given back."""
_ECHOES: Final = 16
"""In one word; of more peers, those come first that have waited longest. A hundred agents are
through in 1.4 s while one asks; then in 7 s, in which bounds loosen by 7 ms."""
_ROUNDING_S: Final = 1e-6
_APART_S: Final = 0.05
"""Lockstep's processes that go on without their keeper have clocks that are milliseconds apart: on
one clock, too, a state may come from so much later."""


class PeerClock:
    """What is known of one peer's clock. Times in s; `ahead` is its clock less the own one."""

    __slots__ = ("_claim", "_high", "_high_at", "_low", "_low_at", "stepped_s", "unknown_s")

    def __init__(self) -> None:
        self._low, self._low_at = -math.inf, 0.0
        self._high, self._high_at = math.inf, 0.0
        self._claim: tuple[float, float, float] | None = None
        """Bounds that contradict, and since when they are claimed."""
        self.stepped_s = 0.0
        """By how much the newest word contradicts what is known of the clock."""
        self.unknown_s: float | None = None
        """Since when its states come without its clock being known; None: the clock is known, or
        nothing was heard."""

    @property
    def known(self) -> bool:
        """Both bounds are finite."""
        return self._high < math.inf and self._low > -math.inf

    def bounds(self, now: float) -> tuple[float, float]:
        """(least, most) that the clock is ahead; infinite where nothing is known."""
        low = self._low - DRIFT * max(0.0, now - self._low_at)
        high = self._high + DRIFT * max(0.0, now - self._high_at)
        return low, max(low, high)

    def beyond(self, told_s: float, received_s: float) -> float:
        """By how much a message that shows `told_s` is from later than can be [s]; 0: it can be."""
        most = self._high + DRIFT * max(0.0, received_s - self._high_at) + _ROUNDING_S
        return max(0.0, told_s - received_s - most)

    def told(self, told_s: float, received_s: float) -> None:
        """The clock showed `told_s` when a message left that came at `received_s`."""
        low, at_least = self.bounds(received_s)[0], told_s - received_s
        if at_least > low - _LATE_S:
            self._claim = None
        if at_least > low:
            self._low, self._low_at = at_least, received_s
        if self.beyond(told_s, received_s) or (self._high == math.inf and self.unknown_s is None):
            self.forget(told_s, received_s)

    def forget(self, told_s: float, received_s: float) -> None:
        """The clock was set back, or is another one: only what it told now is known."""
        self._low, self._low_at, self._high = told_s - received_s, received_s, math.inf
        self._claim, self.unknown_s = None, received_s

    def answered(self, asked_s: float, heard_s: float, told_s: float, received_s: float) -> None:
        """A round trip: t1 to t4 of the module's docstring; `heard_s` and `told_s` by the peer's
        clock."""
        low, high = told_s - received_s, heard_s - asked_s
        since_then = DRIFT * max(0.0, received_s - asked_s)
        if low > high + since_then + _ROUNDING_S:
            return  # one of the two clocks has jumped in between
        before_low, before_high = self.bounds(received_s)
        anew = low > before_high + _ROUNDING_S or high + since_then < before_low - _ROUNDING_S
        self.stepped_s = max(0.0, low - before_high, before_low - high) if anew else 0.0
        if anew and not self._claimed(low, high + since_then, received_s):
            return
        self._claim = None
        if anew or low > before_low:
            self._low, self._low_at = low, received_s
        if anew or high + since_then < before_high:
            self._high, self._high_at = high, asked_s
        self.unknown_s = None

    def _claimed(self, low: float, high: float, now: float) -> bool:
        """Words have agreed for `STEADY_S` that the clock is between `low` and `high` ahead."""
        least, most, since_s = self._claim or (low, high, now)
        drifted_s = DRIFT * (now - since_s) + _ROUNDING_S
        if low > most + drifted_s or high < least - drifted_s:
            since_s = now
        self._claim = (low, high, since_s)
        return now - since_s >= STEADY_S


class SharedClock(PeerClock):
    """The clock of a peer that the launcher has started on the own clock: it is known exactly, and
    no word of it changes that.

    Another process that speaks as the peer may have another clock: its states are from the future,
    or late on and on. Then the clock is not known until its states are timely again.
    `apart` has the shared clocks that seem to be others.
    """

    __slots__ = ("_apart", "_late_since_s", "early")

    def __init__(self, apart: set[SharedClock]) -> None:
        super().__init__()
        self._apart = apart
        self.early = False
        """Its newest state that was not timely came from the future: no slow machine does that."""
        self._late_since_s: float | None = None

    @property
    def known(self) -> bool:
        """Both bounds are finite."""
        return self not in self._apart or super().known

    def bounds(self, now: float) -> tuple[float, float]:
        """(0, 0) while it is the own one."""
        return (0.0, 0.0) if self not in self._apart else super().bounds(now)

    def beyond(self, told_s: float, received_s: float) -> float:
        """As of any clock; 0 for what may be of the own one."""
        if self in self._apart:
            return super().beyond(told_s, received_s)
        ahead_s = told_s - received_s
        return ahead_s if ahead_s > _APART_S else 0.0

    def told(self, told_s: float, received_s: float) -> None:
        """As of any clock, and whether it is the own one."""
        ahead_s = told_s - received_s
        if -_LATE_S <= ahead_s <= _APART_S:
            self._late_since_s = self.unknown_s = None
            self._apart.discard(self)
            return
        if self in self._apart:
            super().told(told_s, received_s)
            return
        since_s = received_s if self._late_since_s is None else self._late_since_s
        self._late_since_s = since_s
        if ahead_s > 0.0 or received_s - since_s >= _OTHER_S:
            self.forget(told_s, received_s)

    def forget(self, told_s: float, received_s: float) -> None:
        """It is another clock."""
        self._late_since_s, self.early = None, told_s > received_s
        self._apart.add(self)
        super().forget(told_s, received_s)

    def answered(self, asked_s: float, heard_s: float, told_s: float, received_s: float) -> None:
        """As of any clock; while it is the own one, only whether the word contradicts that."""
        if self in self._apart:
            super().answered(asked_s, heard_s, told_s, received_s)
        elif told_s - received_s <= heard_s - asked_s + _ROUNDING_S:
            self.stepped_s = max(0.0, told_s - received_s, asked_s - heard_s)


class Clocks:
    """One agent's knowledge of its peers' clocks, and what it says of its own. `same`: those that
    the launcher has started on the same clock."""

    def __init__(self, own_id: int, others: Iterable[int], same: Container[int] = ()) -> None:
        self._own = own_id
        self._apart = set[SharedClock]()
        self.of = {
            agent: SharedClock(self._apart) if agent in same else PeerClock() for agent in others
        }
        self._others = [c for c in self.of.values() if not isinstance(c, SharedClock)]
        self._words: dict[int, tuple[float, float]] = {}
        """By agent that wants answers: the time its newest word told, and when it came; the next to
        be given back first."""
        self._said_s = self._asked_s = -math.inf

    def hear(self, news: ClockNews, received_s: float) -> None:
        """Take a peer's word in. `received_s` is when it came, not when it was read."""
        clock = self.of.get(news.agent)
        if clock is None:
            return
        if news.wants is Answers.NONE:
            self._words.pop(news.agent, None)
        else:
            self._words[news.agent] = (news.time_s, received_s)
        if news.wants is Answers.SOON:
            self._asked_s = received_s
        for echo in news.echoes:
            if echo.agent == self._own:
                clock.answered(echo.told_s, news.time_s - echo.held_s, news.time_s, received_s)

    def say(self, now: float) -> ClockNews | None:
        """The own word, if it is due: none where all share one clock and none was asked for. An
        agent that only answers wants no answer, so the words end with the last question. A shared
        clock that seems to be another one is asked for where its states come from the future, or
        its agent says words itself: states are late where a machine can't keep up, and words would
        add to that."""
        one_clock = not (self._others or self._apart or self._words)
        if one_clock or now - self._said_s < ASK_EVERY_S - _ROUNDING_S:
            return None
        words = [self.of[i] for i in self._words]
        others = [*self._others, *(c for c in self._apart if c.early or c in words)]
        if not (others or words):
            return None
        asks = any(clock.unknown_s is not None for clock in others)
        soon = asks or now - self._asked_s <= EVERY_S
        if not soon and now - self._said_s < EVERY_S - _ROUNDING_S:
            return None
        self._said_s = now
        kept = {i: word for i, word in self._words.items() if now - word[1] <= _ECHOED_S}
        turn = list(kept)[:_ECHOES]
        echoes = tuple(ClockEcho(i, kept[i][0], now - kept[i][1]) for i in turn)
        for i in turn:
            kept[i] = kept.pop(i)  # to the end
        self._words = kept
        wants = Answers.SOON if asks else Answers.REGULAR if others else Answers.NONE
        return ClockNews(self._own, now, wants, echoes)
