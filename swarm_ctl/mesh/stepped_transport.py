"""The mesh in lockstep: each message carries the tick in which it was said and its number among
those under its key, so that a tick hears exactly what was said in the tick before, in a fixed
order. What has not come is said again."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

from swarm_ctl.core.kernel.boundary import FOLLOW_TICKS
from swarm_ctl.core.model.messages import Refusal
from swarm_ctl.mesh.keys import QUEUE, Channel, Qos
from swarm_ctl.mesh.transport import Carried, Inlet, Message, Transport

_MARK: Final = struct.Struct("<IH")
"""A tick, and the message's number under its key in that tick."""
MARK_SIZE: Final = _MARK.size
_AHEAD_TICKS: Final = 2
"""Another member may have done the tick that this one begins; none is farther ahead of what this
one has heard."""
Marked: TypeAlias = tuple[str, Carried, bytes]
"""(key, bytes, mark) of a message."""
_Said: TypeAlias = tuple[str, bytes, Qos, bytes]


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


class SteppedInlet(Inlet):
    """One subscription; `drain` gives what belongs to the tick.

    Args:
        source: where its messages come from.
        begins: the first tick of which messages count. How long a subscription takes is the
            machine's; from which tick on it counts is not.
        end: forgets this inlet.
    """

    def __init__(self, source: MarkedSource, begins: int, end: Callable[[], object]) -> None:
        self._take, self._unsubscribe = source
        self.begins = begins
        self._forget = end
        self.waiting: dict[int, dict[str, dict[int, Carried]]] = {}
        """Messages by tick, key and number."""
        self._loose: list[tuple[str, Carried]] = []
        """Messages of no tick that is waited for: they are heard when they come."""
        self._given: list[Message] = []

    def fill(self, given: int, silent: set[str]) -> None:
        """Take in what has come. `given`: what was said up to this tick was given out, but for what
        the keys `silent` still owe."""
        took = False
        for _ in range(QUEUE):
            item = self._take()
            if item is None:
                break
            took = True
            key, data, mark = item
            tick, number = _MARK.unpack(mark) if len(mark) == MARK_SIZE else (-1, 0)
            if given < tick <= given + _AHEAD_TICKS:
                if tick >= self.begins:
                    self.waiting.setdefault(tick, {}).setdefault(key, {})[number] = data
            elif not 0 <= tick <= given or (tick and key in silent):  # else it was said again
                self._loose.append((key, data))
        if took:
            self._bound()

    def _bound(self) -> None:
        """What waits for a later tick is at most `QUEUE` messages: the key with the most loses
        them."""
        while sum(len(said) for tick in self.waiting.values() for said in tick.values()) > QUEUE:
            _, tick, key = max(
                (len(said), tick, key)
                for tick, by_key in self.waiting.items()
                for key, said in by_key.items()
            )
            del self.waiting[tick][key]

    def has(self, tick: int, key: str, count: int) -> bool:
        """Whether so many messages have come that were said in this tick under this key."""
        return len(self.waiting.get(tick, {}).get(key, ())) >= count

    def give(self, heard: int | None, received_s: float, order: Mapping[str, int]) -> None:
        """Give out what was said up to tick `heard` (None: all), by tick and in this order of the
        keys; what was said in tick 0 is no message."""
        if self._loose:
            self._given += [(received_s, key, data) for key, data in self._loose]
            self._loose = []
        for tick in sorted(t for t in self.waiting if heard is None or t <= heard):
            by_key = self.waiting.pop(tick)
            for key in sorted(by_key, key=lambda key: order.get(key, -1)) if tick else ():
                said = by_key[key]
                self._given += [(received_s, key, said[number]) for number in sorted(said)]

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
        self._tick = 0
        self._given = -1
        self._free = False
        self._counts: dict[str, int] = {}
        self._said: dict[int, list[_Said]] = {0: []}
        """What this member said in its newest ticks. Who has not heard one of them holds the clock,
        so it is not asked for an older one than that before the last one."""
        self._own: set[str] = set()
        self._inlets: dict[str, SteppedInlet] = {}
        self._routes: dict[str, SteppedInlet | None] = {}
        """What hears a key."""
        self._silent: set[str] = set()
        """Keys of which a message was missed: not waited for until one comes in time."""

    def begin(self, tick: int) -> None:
        """What is said now belongs to this tick, as does what was said since the last one."""
        if tick != self._tick:
            since = self._said.pop(self._tick, [])
            self._enter(tick)
            for key, data, qos, _ in since:
                self.publish(key, data, qos)

    def end(self) -> dict[str, int]:
        """The tick is over: so many messages were said in it, by key."""
        counts = self._counts
        self._enter(self._tick + 1)
        return counts

    def _enter(self, tick: int) -> None:
        kept = {t: said for t, said in self._said.items() if t >= tick - 2}
        self._said = kept | {tick: []}
        self._tick, self._counts = tick, {}

    def let_run(self) -> None:
        """From now on as without lockstep."""
        self._free = True

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        if self._free:
            self._inner.publish(key, data, qos)
            return
        number = self._counts.get(key, 0)
        self._counts[key] = number + 1
        if key not in self._own:
            self._own.add(key)
            self._routes.clear()
        mark = _MARK.pack(self._tick, number)
        self._said[self._tick].append((key, data, qos, mark))
        self._inner.publish(key, data, qos, mark)

    def answer(self, swarm: str, name: int | str, channels: Iterable[Channel[Any]]) -> None:
        """To the roll call: an empty message on each channel."""
        for channel in channels:
            self.publish(channel.key(swarm, name), b"", channel.qos)

    def say_again(self, tick: int, keys: Sequence[str]) -> None:
        """What was said in this tick under these keys."""
        for key, data, qos, mark in self._said.get(tick, ()):
            if key in keys:
                self._inner.publish(key, data, qos, mark)

    def subscribe(self, key_expression: str, *, timed: bool = False) -> SteppedInlet:  # noqa: ARG002 - always
        begins = self._tick + FOLLOW_TICKS if self._tick else 0
        source = self._inner.subscribe_marked(key_expression)
        inlet = SteppedInlet(source, begins, lambda: self._end(key_expression))
        self._inlets[key_expression] = inlet
        self._routes.clear()
        return inlet

    def _end(self, key_expression: str) -> None:
        self._inlets.pop(key_expression, None)
        self._routes.clear()

    def _route(self, key: str) -> SteppedInlet | None:
        if key in self._own:
            return None
        kind, _, channel = key.rsplit("/", 2)
        return self._inlets.get(key) or self._inlets.get(f"{kind}/*/{channel}")

    def lacking(self, heard: int, said: Mapping[str, int]) -> dict[str, int]:
        """Of what was `said` in the tick `heard`, messages by key, that which has not come yet."""
        for inlet in self._inlets.values():
            inlet.fill(self._given, self._silent)
        routes, lacking = self._routes, {}
        for key, count in said.items():  # a large swarm says hundreds
            try:
                inlet_of = routes[key]
            except KeyError:
                inlet_of = routes[key] = self._route(key)
            if inlet_of is None or heard < inlet_of.begins:
                continue
            if inlet_of.has(heard, key, count):
                self._silent.discard(key)
            elif key not in self._silent:
                lacking[key] = count
        return lacking

    def give_up(self, keys: Iterable[str]) -> None:
        """Do not wait for these again before a message of theirs comes in time."""
        self._silent.update(keys)

    def give(self, heard: int, received_s: float, said: Iterable[str] = ()) -> None:
        """Let the inlets give out what was said up to tick `heard`, in the order of these keys."""
        order = {key: i for i, key in enumerate(said)}
        for inlet in self._inlets.values():
            inlet.give(heard, received_s, order)
        self._given = heard

    def give_all(self, now: Callable[[], float]) -> None:
        """Let them give out all that has come, received when all is read (as `RingInlet`)."""
        for inlet in self._inlets.values():
            inlet.fill(self._given, self._silent)
        received_s = now()
        for inlet in self._inlets.values():
            inlet.give(None, received_s, {})

    def refused(self, now: float) -> tuple[Refusal, ...]:
        return self._inner.refused(now)

    def close(self) -> None:
        self._inner.close()
