"""The mesh in lockstep: each message carries who published it in which tick, so that a tick gets
exactly those of the tick before, in a fixed order."""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from operator import itemgetter
from typing import Any, Final, Protocol

from swarm_ctl.mesh.keys import CHANNELS, Channel, Qos
from swarm_ctl.mesh.transport import Inlet, Transport

_MARK: Final = struct.Struct("<HI")
"""A member's number, and a tick; 0: a hello, which is no message."""
_OUTSIDER: Final = 0xFFFF
"""A publisher that is no member, such as `swarm-ctl send`: its messages come when they come."""
INDEX: Final = {channel.name: i for i, channel in enumerate(CHANNELS)}


class MarkedTransport(Transport, Protocol):
    """A transport whose messages carry a mark beside their bytes."""

    def publish(self, key: str, data: bytes, qos: Qos, mark: bytes = b"") -> None:
        """Send without blocking."""

    def subscribe_marked(self, key_expression: str) -> Callable[[], tuple[bytes, bytes] | None]:
        """What takes the next (bytes, mark) that waits; None: none does."""


class SteppedInlet(Inlet):
    """One subscription; `drain` gives what belongs to the tick."""

    def __init__(self, take: Callable[[], tuple[bytes, bytes] | None]) -> None:
        self._take = take
        self._waiting: list[tuple[int, int, bytes]] = []
        self.counts: dict[int, Counter[int]] = defaultdict(Counter)
        """Messages that have come, by tick and member."""
        self.heard: set[int] = set()
        """Members of which anything has come."""
        self._given: list[tuple[float, bytes]] = []

    def fill(self) -> None:
        """Take in what has come."""
        while (item := self._take()) is not None:
            data, mark = item
            member, tick = _MARK.unpack(mark) if len(mark) == _MARK.size else (_OUTSIDER, -1)
            self.heard.add(member)
            if tick:
                self.counts[tick][member] += 1
                self._waiting.append((member, tick, data))

    def give(self, heard: int | None, received_s: float) -> None:
        """Give out what was published up to tick `heard` (None: all), by tick and member, each
        one's in their order."""
        waiting, self._waiting = self._waiting, []
        now = waiting if heard is None else [item for item in waiting if item[1] <= heard]
        if len(now) < len(waiting) and heard is not None:
            self._waiting = [item for item in waiting if item[1] > heard]
        now.sort(key=itemgetter(1, 0))
        self._given += [(received_s, data) for _, _, data in now]
        for tick in [t for t in self.counts if heard is None or t <= heard]:
            del self.counts[tick]

    def drain(self) -> list[tuple[float, bytes]]:
        given, self._given = self._given, []
        return given


class SteppedTransport(Transport):
    """Wraps the transport of one member."""

    def __init__(self, inner: MarkedTransport) -> None:
        self._inner = inner
        self._mark = b""
        self._published: Counter[int] = Counter()
        self._channels: dict[str, int] = {}
        self._inlets: dict[int, SteppedInlet] = {}
        self._unwaited: set[tuple[int, int]] = set()
        """Members (by channel) of which a message was missed: not waited for until one comes."""

    def begin(self, member: int, tick: int) -> None:
        """What is published now belongs to this tick; 0: hellos."""
        self._mark = _MARK.pack(member, tick)

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = INDEX[key.rpartition("/")[2]]
        self._published[channel] += 1
        self._inner.publish(key, data, qos, self._mark)

    def published(self) -> dict[int, int]:
        """Messages by channel since the last call."""
        published, self._published = self._published, Counter()
        return published

    def subscribe(self, key_expression: str, *, timed: bool = False) -> SteppedInlet:  # noqa: ARG002 - always
        inlet = SteppedInlet(self._inner.subscribe_marked(key_expression))
        self._inlets[INDEX[key_expression.rpartition("/")[2]]] = inlet
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
        for channel, inlet in self._inlets.items():
            inlet.fill()
            heard |= inlet.heard
            missing |= set(members.get(CHANNELS[channel].publisher, ())) - inlet.heard
        return missing - heard if any_channel else missing

    def lacking(
        self, heard: int, published: Iterable[tuple[int, int, int]], own: int
    ) -> list[tuple[int, int]]:
        """Members and channels of whose messages of tick `heard` some have not come yet."""
        for inlet in self._inlets.values():
            inlet.fill()
        missing = []
        for member, channel, count in published:
            inlet = self._inlets.get(channel)  # type: ignore[assignment]  # None below
            if inlet is None or member == own:
                continue
            if inlet.counts[heard][member] >= count:
                self._unwaited.discard((member, channel))
            else:
                missing.append((member, channel))
        return [item for item in missing if item not in self._unwaited]

    def give(self, heard: int | None, received_s: float) -> None:
        """Let the inlets give out what was published up to tick `heard`; None: all."""
        for inlet in self._inlets.values():
            if heard is None:
                inlet.fill()
            inlet.give(heard, received_s)

    def give_up(self, lacking: Iterable[tuple[int, int]]) -> None:
        """Do not wait for these again before one of their messages comes in time."""
        self._unwaited.update(lacking)

    def close(self) -> None:
        self._inner.close()
