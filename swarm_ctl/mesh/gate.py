"""What of a channel's messages is read at all: of each owner of keys as many as the channel's
bounds allow, the newest first, so that a flood of one takes nothing from the others. In a flood
under an owner's own key, what may follow what was believed of the owner has an allowance apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, Final, TypeAlias

from swarm_ctl.core.model.messages import Glimpse, Refusal, RefusalReason
from swarm_ctl.core.model.text import printable
from swarm_ctl.mesh.keys import BEACON, COMMAND, Bounds, Channel, owner_of
from swarm_ctl.mesh.payloads import glimpse
from swarm_ctl.mesh.transport import Carried, Message

_STRANGERS: Final = 32
"""Owners that are not in the plan (stations, other agents) and have an allowance of their own; all
others share one."""
_CROWD_COMMANDS_PER_S: Final = 400.0
"""Of all further names together: more than two links may bring (`zenoh_config.py`)."""
_IDLE_S: Final = 60.0
"""A stranger that was silent for so long gives its place to a new one."""
_FAMILIAR_S: Final = 2.0
"""A station is familiar when its beacons have come for so long; a name that comes once never is."""
_NAMES: Final = 1024
"""That are remembered at a time: a new one takes the place of one that fell silent."""
_SET_BACK_S: Final = 1.0
"""By more than this the own clock was set back (a station's, to that of the swarm)."""
_LONGEST_KEY: Final = 256
_LOOKED: Final = 1024
"""Messages too many of which a tick looks at the newest ones: 20,000 a second, in 3 ms."""
Likely: TypeAlias = Callable[[Glimpse, float], bool]
"""Whether a word, received at this time [s], may follow what was believed of its agent."""


class MeshSource:
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


class Stations:
    """Which stations are familiar, by their beacons. One that was there before a flood of ever new
    names stays so; one that comes into it becomes so when it finds a place."""

    def __init__(self) -> None:
        self._heard: dict[str, tuple[float, float]] = {}
        """(first, newest beacon [s]) by name."""
        self._cleared_s = float("-inf")

    def hear(self, name: str, now: float) -> None:
        """A beacon came at `now` [s]."""
        first, newest = self._heard.get(name, (now, now))
        if name not in self._heard and (len(name) > _LONGEST_KEY or not self._room(now)):
            return
        # a clock that was set back, or a long silence, starts anew
        known = newest <= now <= newest + _IDLE_S
        self._heard[name] = (first if known else now, now)

    def familiar(self, name: str) -> bool:
        """Its beacons have come for some time."""
        first, newest = self._heard.get(name, (0.0, 0.0))
        return newest - first >= _FAMILIAR_S

    def _room(self, now: float) -> bool:
        if len(self._heard) >= _NAMES and abs(now - self._cleared_s) > _FAMILIAR_S:
            self._cleared_s = now
            self._heard = {n: h for n, h in self._heard.items() if self._stays(n, now - h[1])}
        return len(self._heard) < _NAMES

    def _stays(self, name: str, silent_s: float) -> bool:
        return silent_s < (_IDLE_S if self.familiar(name) else _FAMILIAR_S / 2)


class Gate:
    """Of one channel. The owners in `known` have an allowance of their own, always; so have
    `stations` that are familiar."""

    def __init__(
        self, channel: Channel[Any], keys: Iterable[str], refusals: Refusals, stations: Stations
    ) -> None:
        self._channel = channel
        self._refusals = refusals
        self._stations = stations
        self._familiar: dict[str, MeshSource] = {}
        self._known = {key: self._source(key) for key in keys}
        self._apart: dict[MeshSource, MeshSource] = {}
        """Of the known ones, the allowances of what is likely in a flood."""
        self._strangers: dict[str, MeshSource] = {}
        crowded = channel.bounds._replace(per_s=_CROWD_COMMANDS_PER_S)
        self._crowd = MeshSource(OTHERS, None, crowded if channel is COMMAND else channel.bounds)
        self._cleared_s = float("-inf")

    def _source(self, key: str) -> MeshSource:
        owner = owner_of(key)
        return MeshSource(named(owner), _name(self._channel.publisher, owner), self._channel.bounds)

    def _allowance(self, key: str, now: float) -> MeshSource:
        """Whose allowance a message under `key` takes: for a name too many, without any work."""
        found = self._strangers.get(key) or self._familiar.get(key)
        if found is not None:
            return found
        if self._channel.publisher == "station" and self._stations.familiar(owner_of(key)[1]):
            self._familiar = {k: s for k, s in self._familiar.items() if not s.idle(now)}
            found = self._familiar[key] = self._source(key)
            return found
        if len(self._strangers) >= _STRANGERS and now - self._cleared_s > 1.0:
            self._cleared_s = now
            self._strangers = {k: s for k, s in self._strangers.items() if not s.idle(now)}
        if len(self._strangers) >= _STRANGERS or len(key) > _LONGEST_KEY:
            return self._crowd
        found = self._strangers[key] = self._source(key)
        return found

    def admit(
        self, messages: list[Message], likely: Likely | None = None
    ) -> list[tuple[float, MeshSource, bytes]]:
        """(received_s [s], source, bytes) of those that may be read, oldest first. Where an agent
        of the plan has too many, as many again of those that are `likely`."""
        taken: list[tuple[float, MeshSource, bytes]] = []
        dropped: list[MeshSource] = []
        looked = 0
        size, known = self._channel.bounds.size, self._known
        if self._channel is BEACON:
            for received_s, key, _ in messages:
                self._stations.hear(owner_of(key)[1], received_s)
        for received_s, key, data in reversed(messages):
            source = known.get(key) or self._allowance(key, received_s)
            if not source.admit(received_s):
                looks = looked < _LOOKED and key in known
                looked += looks
                if not (likely and looks and self._likely(source, data, received_s, likely)):
                    dropped.append(source)
                    continue
            if source is self._crowd and len(key) <= _LONGEST_KEY:
                source = self._source(key)
            if len(data) > size:
                self._too_large(source, len(data), received_s)
            else:
                taken.append((received_s, source, bytes(data)))
        if dropped:
            self._too_many(Counter(dropped), messages[-1][0])
        taken.reverse()
        return taken

    def _likely(self, source: MeshSource, data: Carried, received_s: float, likely: Likely) -> bool:
        """Of a source that has too many, this one is read all the same."""
        word = glimpse(self._channel.payload, bytes(data))
        if word is None or word.agent != source.name or not likely(word, received_s):
            return False
        apart = self._apart.get(source)
        if apart is None:
            apart = MeshSource(source.owner, source.name, self._channel.bounds)
            self._apart[source] = apart
        return apart.admit(received_s)

    def refuse(self, source: MeshSource, reason: RefusalReason, words: str, now: float) -> None:
        """Count a message that was read."""
        what = f"a {self._channel.name} under {source.owner}'s key {words}"
        self._refusals.add(source.owner, reason, what, now)

    def _too_large(self, source: MeshSource, size: int, now: float) -> None:
        limit = self._channel.bounds.size
        words = f"has {size} bytes; allowed: at most {limit}"
        self.refuse(source, RefusalReason.TOO_LARGE, words, now)

    def _too_many(self, dropped: Counter[MeshSource], now: float) -> None:
        name, per_s = self._channel.name, self._channel.bounds.per_s
        for source, count in dropped.items():
            words = (
                f"too many {name} messages under {source.owner}'s key, which on an open mesh each"
                f" may use; allowed: {per_s:g} a second"
            )
            self._refusals.add(source.owner, RefusalReason.TOO_MANY, words, now, count)


def _name(publisher: str, owner: tuple[str, str]) -> int | str | None:
    kind, name = owner
    if kind != publisher:
        return None
    if kind != "agent":
        return name
    return int(name) if name.isascii() and name.isdigit() and str(int(name)) == name else None


RECENT_S: Final = 10.0
"""A refusal is told for so long."""
_OWNERS: Final = 64
OTHERS: Final = "others"
"""All owners beyond `_OWNERS` within `RECENT_S`."""
_TOLD: Final = 8
_NAME: Final = 40


def named(owner: tuple[str, str]) -> str:
    """`agent 7`: an owner of keys for an operator, safe on a terminal whatever its name is."""
    return f"{owner[0]} {printable(owner[1], _NAME)}"


class Refusals:
    """A table of bounded size."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, RefusalReason], Refusal] = {}
        self.unread = 0
        """Messages that were refused for what they are: too large, unreadable, another owner's."""

    def add(
        self, owner: str, reason: RefusalReason, words: str, now: float, count: int = 1
    ) -> None:
        """Count `count` messages of `owner` at `now` [s]."""
        if reason is not RefusalReason.TOO_MANY:
            self.unread += count
        words = printable(words)
        if (owner, reason) not in self._kept and len(self._kept) >= _OWNERS:
            old = [key for key, kept in self._kept.items() if now - kept.time_s > RECENT_S]
            for key in old:
                del self._kept[key]
            owner = owner if old else OTHERS
        before = self._kept.get((owner, reason))
        total = count + (before.count if before else 0)
        self._kept[owner, reason] = Refusal(owner, reason, words, total, now)

    def recent(self, now: float) -> tuple[Refusal, ...]:
        """Those of the last `RECENT_S`, the newest first, at most eight."""
        if not self._kept:
            return ()
        found = [refusal for refusal in self._kept.values() if now - refusal.time_s <= RECENT_S]
        return tuple(sorted(found, key=lambda refusal: -refusal.time_s)[:_TOLD])
