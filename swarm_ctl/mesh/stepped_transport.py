"""The mesh in lockstep: each message carries who published it in which tick, so that a tick gets
exactly those of the tick before, in a fixed order."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from operator import itemgetter
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

from swarm_ctl.core.kernel.boundary import FOLLOW_TICKS
from swarm_ctl.core.model.messages import Refusal
from swarm_ctl.mesh.keys import CHANNELS, QUEUE, Channel, Qos, owner_of
from swarm_ctl.mesh.transport import Carried, Inlet, Message, Transport

_MARK: Final = struct.Struct("<HI")
"""A member's number, and a tick; 0: a hello, which is no message."""
MARK_SIZE: Final = _MARK.size
_OUTSIDER: Final = 0xFFFF
"""A publisher that is no member, such as `swarm-ctl send`: its messages come when they come."""
_AHEAD: Final = 4096
"""Ticks that a mark may be ahead of the own tick: as many messages as a subscription keeps."""
Marked: TypeAlias = tuple[str, Carried, bytes]
"""(key, bytes, mark) of a message."""
Owners: TypeAlias = dict[int, tuple[str, str]]
"""By member: what owns the keys that it speaks under (`keys.owner_of`)."""
INDEX: Final = {channel.name: i for i, channel in enumerate(CHANNELS)}


class MarkedSource(NamedTuple):
    """A subscription to messages with marks."""

    take: Callable[[], Marked | None]
    """The next message that waits; None: none does."""
    end: Callable[[], None]


class MarkedTransport(Transport, Protocol):
    """A transport whose messages carry a mark beside their bytes."""

    def publish(self, key: str, data: bytes, qos: Qos, mark: bytes = b"") -> None:
        """Send without blocking."""

    def subscribe_marked(self, key_expression: str) -> MarkedSource:
        """As `subscribe`."""


def _stream(key: str) -> tuple[int, str]:
    """A key's channel, as its place in `CHANNELS`, and its publisher's name; `*`: all of them."""
    owner, _, channel = key.rpartition("/")
    return INDEX[channel], owner.rpartition("/")[2]


class SteppedInlet(Inlet):
    """One subscription; `drain` gives what belongs to the tick.

    Args:
        source: where its messages come from.
        owners: by member, what owns the keys that it speaks under.
        begins: the first tick of which messages count. How long a subscription takes is the
            machine's; from which tick on it counts is not.
        end: forgets this inlet.
    """

    def __init__(
        self, source: MarkedSource, owners: Owners, begins: int, end: Callable[[], object]
    ) -> None:
        self._take, self._unsubscribe = source
        self._owners = owners
        self.begins = begins
        self._forget = end
        self._waiting: list[tuple[int, int, str, Carried]] = []
        self.counts: dict[tuple[int, int], int] = {}
        """Messages that have come, by (tick, member)."""
        self.heard: set[int] = set()
        """Members of which anything has come."""
        self._given: list[Message] = []

    def fill(self, heard: int | None = None) -> None:
        """Take in what has come; `heard`: up to which tick this process hears now."""
        for _ in range(QUEUE):
            item = self._take()
            if item is None:
                break
            key, data, mark = item
            member, tick = self._placed(key, mark, heard)
            if member != _OUTSIDER:
                self.heard.add(member)
            if tick and not 0 < tick < self.begins:
                self.counts[tick, member] = self.counts.get((tick, member), 0) + 1
                self._waiting.append((member, tick, key, data))
        self._bound()

    def _placed(self, key: str, mark: bytes, heard: int | None) -> tuple[int, int]:
        """Whose message it is, and of which tick. A member's number belongs to the owner of the key
        that it was first heard under: no other can speak, or be counted, in its place."""
        if len(mark) != _MARK.size:
            return _OUTSIDER, -1
        member, tick = _MARK.unpack(mark)
        known = len(self._owners) < QUEUE or member in self._owners
        mine = known and self._owners.setdefault(member, owner_of(key)) == owner_of(key)
        if member == _OUTSIDER or not mine or (heard is not None and tick > heard + _AHEAD):
            return _OUTSIDER, -1
        return member, tick

    def _bound(self) -> None:
        """What waits for a later tick is at most `QUEUE`: the key with the most loses its oldest
        ones."""
        while (excess := len(self._waiting) - QUEUE) > 0:
            [(most, count)] = Counter(key for _, _, key, _ in self._waiting).most_common(1)
            going = min(excess, count)
            kept = []
            for item in self._waiting:
                if going and item[2] == most:
                    going -= 1
                else:
                    kept.append(item)
            self._waiting = kept

    def give(self, heard: int | None, received_s: float) -> None:
        """Give out what was published up to tick `heard` (None: all), by tick and member, each
        one's in their order."""
        if not self._waiting and not self.counts:  # as on most channels in most ticks
            return
        waiting, self._waiting = self._waiting, []
        now = waiting if heard is None else [item for item in waiting if item[1] <= heard]
        if len(now) < len(waiting) and heard is not None:
            self._waiting = [item for item in waiting if item[1] > heard]
        now.sort(key=itemgetter(1, 0))
        self._given += [(received_s, key, data) for _, _, key, data in now]
        later = {key: n for key, n in self.counts.items() if heard is not None and key[0] > heard}
        self.counts = later

    def drain(self) -> list[Message]:
        given, self._given = self._given, []
        return given

    def end(self) -> None:
        self._unsubscribe()
        self._forget()


class SteppedTransport(Transport):
    """Wraps the transport of one member."""

    def __init__(self, inner: MarkedTransport) -> None:
        self._inner = inner
        self._mark = b""
        self._tick = 0
        self._published: dict[int, int] = {}
        self._channels: dict[str, int] = {}
        self._inlets: dict[tuple[int, str], SteppedInlet] = {}
        self._unwaited: set[tuple[int, int]] = set()
        """Members (by channel) of which a message was missed: not waited for until one comes."""
        self._owners: Owners = {}

    def know(self, owners: Owners) -> None:
        """What owns the keys of these members; of others, the first message tells."""
        self._owners.update(owners)

    def begin(self, member: int, tick: int) -> None:
        """What is published now belongs to this tick; 0: hellos."""
        self._mark, self._tick = _MARK.pack(member, tick), tick

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = INDEX[key.rpartition("/")[2]]
        self._published[channel] = self._published.get(channel, 0) + 1
        self._inner.publish(key, data, qos, self._mark)

    def published(self) -> dict[int, int]:
        """Messages by channel since the last call."""
        published, self._published = self._published, {}
        return published

    def subscribe(self, key_expression: str, *, timed: bool = False) -> SteppedInlet:  # noqa: ARG002 - always
        begins = self._tick + FOLLOW_TICKS if self._tick else 0
        source = self._inner.subscribe_marked(key_expression)
        stream = _stream(key_expression)
        inlet = SteppedInlet(source, self._owners, begins, lambda: self._inlets.pop(stream, None))
        self._inlets[stream] = inlet
        return inlet

    def hello(self, swarm: str, name: int | str, channels: Iterable[Channel[Any]]) -> None:
        """Say on each channel that its messages will come this way."""
        for channel in channels:
            self._inner.publish(channel.key(swarm, name), b"", channel.qos, self._mark)

    def unheard(
        self, members: Mapping[str, Iterable[int]], *, any_channel: bool = False
    ) -> set[int]:
        """Members (by the channels' publisher, `agent` or `station`) of which nothing has come on a
        channel that is subscribed to, or (`any_channel`) on all of them."""
        missing: set[int] = set()
        heard: set[int] = set()
        for (channel, _), inlet in self._inlets.items():
            inlet.fill()
            heard |= inlet.heard
            missing |= set(members.get(CHANNELS[channel].publisher, ())) - inlet.heard
        return missing - heard if any_channel else missing

    def lacking(
        self, heard: int, published: Iterable[tuple[int, int, int]], own: int
    ) -> list[tuple[int, int]]:
        """Members and channels of whose messages of tick `heard` some have not come yet."""
        for each in self._inlets.values():
            each.fill(heard)
        every = {channel: i for (channel, name), i in self._inlets.items() if name == "*"}
        followed = {channel for channel, name in self._inlets if name != "*"}
        missing = []
        for member, channel, count in published:  # a large swarm publishes hundreds
            inlet = every.get(channel)
            if inlet is None and channel in followed and member in self._owners:
                inlet = self._inlets.get((channel, self._owners[member][1]))
            if inlet is None or member == own or heard < inlet.begins:
                continue
            if inlet.counts.get((heard, member), 0) >= count:
                self._unwaited.discard((member, channel))
            elif (member, channel) not in self._unwaited:
                missing.append((member, channel))
        return missing

    def unproven(self, published: Iterable[tuple[int, int, int]]) -> bool:
        """A subscription begins to count with the next tick, and nothing has come yet by which it
        is known to work; `published`: which members speak."""
        due = {p: i for p, i in self._inlets.items() if i.begins == self._tick + 1 and not i.heard}
        for inlet in due.values():
            inlet.fill()
        silent = {stream for stream, inlet in due.items() if not inlet.heard}
        speak = ((channel, self._owners.get(m, ("", ""))[1]) for m, channel, _ in published)
        return not silent.isdisjoint(speak) if silent else False

    def give(self, heard: int | None, received_s: float) -> None:
        """Let the inlets give out what was published up to tick `heard`; None: all."""
        for inlet in self._inlets.values():
            if heard is None:
                inlet.fill()
            inlet.give(heard, received_s)

    def give_up(self, lacking: Iterable[tuple[int, int]]) -> None:
        """Do not wait for these again before one of their messages comes in time."""
        self._unwaited.update(lacking)

    def refused(self, now: float) -> tuple[Refusal, ...]:
        return self._inner.refused(now)

    def close(self) -> None:
        self._inner.close()
