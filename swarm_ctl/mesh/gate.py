"""What of a channel's messages is read at all: of each owner of keys as many as the channel's
bounds allow, the newest first, so that a flood of one takes nothing from the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, Final

from swarm_ctl.core.model.messages import RefusalReason
from swarm_ctl.mesh.keys import Bounds, Channel, owner_of
from swarm_ctl.mesh.refusals import OTHERS, Refusals, named
from swarm_ctl.mesh.transport import Message

_STRANGERS: Final = 32
"""Owners that are not in the plan (stations, other agents) and have an allowance of their own; all
others share one."""
_IDLE_S: Final = 60.0
"""A stranger that was silent for so long gives its place to a new one."""
_SET_BACK_S: Final = 1.0
"""By more than this the own clock was set back (a station's, to that of the swarm)."""
_LONGEST_KEY: Final = 256


class Source:
    """One key of a channel, and what its owner may still send: a bucket of tokens."""

    __slots__ = ("_at_s", "_bounds", "_tokens", "name", "owner")

    def __init__(self, owner: str, name: int | str | None, bounds: Bounds) -> None:
        self.owner: Final = owner
        """For an operator."""
        self.name: Final = name
        """The agent's id or the station's name, as the payload has to have it; None: the key is no
        publisher's."""
        self._bounds = bounds
        self._tokens = float(bounds.burst)
        self._at_s = float("-inf")

    def admit(self, now: float) -> bool:
        """Take one message at `now` [s], if it may."""
        if now > self._at_s:
            _, per_s, burst = self._bounds
            self._tokens = min(burst, self._tokens + (now - self._at_s) * per_s)
            self._at_s = now
        elif now < self._at_s - _SET_BACK_S:
            self._at_s = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True

    def idle(self, now: float) -> bool:
        """It has been silent for long."""
        return now - self._at_s > _IDLE_S


class Gate:
    """Of one channel. The owners in `known` have an allowance of their own, always."""

    def __init__(self, channel: Channel[Any], keys: Iterable[str], refusals: Refusals) -> None:
        self._channel = channel
        self._refusals = refusals
        self._known = {key: self._source(key) for key in keys}
        self._strangers: dict[str, Source] = {}
        self._crowd = Source(OTHERS, None, channel.bounds)
        self._cleared_s = float("-inf")

    def _source(self, key: str) -> Source:
        owner = owner_of(key)
        return Source(named(owner), _name(self._channel.publisher, owner), self._channel.bounds)

    def _allowance(self, key: str, now: float) -> Source:
        """Whose allowance a message under `key` takes: for a name too many, without any work."""
        found = self._strangers.get(key)
        if found is not None:
            return found
        if len(self._strangers) >= _STRANGERS and now - self._cleared_s > 1.0:
            self._cleared_s = now
            self._strangers = {k: s for k, s in self._strangers.items() if not s.idle(now)}
        if len(self._strangers) >= _STRANGERS or len(key) > _LONGEST_KEY:
            return self._crowd
        found = self._strangers[key] = self._source(key)
        return found

    def admit(self, messages: list[Message]) -> list[tuple[float, Source, bytes]]:
        """(received_s [s], source, bytes) of those that may be read, oldest first."""
        taken: list[tuple[float, Source, bytes]] = []
        dropped: Counter[Source] = Counter()
        size, known = self._channel.bounds.size, self._known
        for received_s, key, data in reversed(messages):
            source = known.get(key) or self._allowance(key, received_s)
            if not source.admit(received_s):
                dropped[source] += 1
                continue
            if source is self._crowd and len(key) <= _LONGEST_KEY:
                source = self._source(key)
            if len(data) > size:
                self._too_large(source, len(data), received_s)
            else:
                taken.append((received_s, source, bytes(data)))
        if dropped:
            self._too_many(dropped, messages[-1][0])
        taken.reverse()
        return taken

    def refuse(self, source: Source, reason: RefusalReason, words: str, now: float) -> None:
        """Count a message that was read."""
        what = f"a {self._channel.name} under {source.owner}'s key {words}"
        self._refusals.add(source.owner, reason, what, now)

    def _too_large(self, source: Source, size: int, now: float) -> None:
        limit = self._channel.bounds.size
        words = f"has {size} bytes; allowed: at most {limit}"
        self.refuse(source, RefusalReason.TOO_LARGE, words, now)

    def _too_many(self, dropped: Counter[Source], now: float) -> None:
        name, per_s = self._channel.name, self._channel.bounds.per_s
        for source, count in dropped.items():
            words = f"too many {name} messages of {source.owner}; allowed: {per_s:g} a second"
            self._refusals.add(source.owner, RefusalReason.TOO_MANY, words, now, count)


def _name(publisher: str, owner: tuple[str, str]) -> int | str | None:
    kind, name = owner
    if kind != publisher:
        return None
    if kind != "agent":
        return name
    return int(name) if name.isascii() and name.isdigit() and str(int(name)) == name else None
