"""A transport with loss, delay, jitter (messages overtake each other), duplicates, silence.

Wraps another transport and changes what comes in. Each publisher's link has its own seeded
generator, and the clock is injected: with the in-memory transport, the same seed gives the same
flight.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from swarm_ctl.core.model.messages import Refusal
from swarm_ctl.mesh.keys import Qos, owner_of
from swarm_ctl.mesh.transport import Carried, Inlet, Message, Transport


@dataclass(frozen=True, slots=True)
class Impairment:
    """What happens to each message. Shares are 0 .. 1, times mission seconds."""

    loss: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Uniform on top of the delay."""
    duplicate: float = 0.0
    """Share that comes twice, each time with its own delay."""


class ImpairedTransport(Transport):
    """Wraps `inner`. `publishers` are all names that may publish: agent ids, and `station` for all
    stations.

    Messages of the publishers in `silent` are lost, also those under way, until the test removes
    the name: a partition, seen from one side.
    """

    def __init__(
        self,
        inner: Transport,
        publishers: Iterable[int | str],
        impairment: Impairment,
        now: Callable[[], float],
        seed: int,
    ) -> None:
        self._inner = inner
        self._publishers = [str(name) for name in publishers]
        self._now = now
        self._seed = seed
        self._inlets = 0
        self.impairment = impairment
        self.silent: set[str] = set()

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        self._inner.publish(key, data, qos)

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        links = {}
        one = owner_of(key_expression)[1]
        for name in self._publishers if one == "*" else [one]:
            self._inlets += 1
            dice = random.Random(self._seed * 1_000_003 + self._inlets)  # noqa: S311 - no secret
            links[name] = _ImpairedLink(self, name, dice)
        return ImpairedInlet(self._inner.subscribe(key_expression, timed=timed), links, self._now)

    def refused(self, now: float) -> tuple[Refusal, ...]:
        return self._inner.refused(now)

    def close(self) -> None:
        self._inner.close()


class _ImpairedLink:
    """The messages of one publisher that are under way."""

    def __init__(self, owner: ImpairedTransport, name: str, dice: random.Random) -> None:
        self._owner, self._name, self._dice = owner, name, dice
        self._waiting: list[tuple[float, int, str, Carried]] = []
        self._count = 0

    def due(self, now: float) -> list[Message]:
        """The messages that have arrived by `now`."""
        if self._name in self._owner.silent:
            self._waiting.clear()
        arrived: list[Message] = []
        while self._waiting and self._waiting[0][0] <= now:
            at, _, key, data = heapq.heappop(self._waiting)
            arrived.append((at, key, data))
        return arrived

    def send(self, sent_s: float, key: str, data: Carried) -> None:
        """A message comes to this link."""
        how, dice = self._owner.impairment, self._dice
        if dice.random() < how.loss:
            return
        for _ in range(1 + (dice.random() < how.duplicate)):
            self._count += 1
            at = sent_s + how.delay_s + how.jitter_s * dice.random()
            heapq.heappush(self._waiting, (at, self._count, key, data))


class ImpairedInlet(Inlet):
    """The messages of all links in the order of arrival. A station that is not among the publishers
    by its own name speaks on the link of `station`."""

    def __init__(
        self, inlet: Inlet, links: Mapping[str, _ImpairedLink], now: Callable[[], float]
    ) -> None:
        self._inlet, self._links, self._now = inlet, links, now

    def drain(self) -> list[Message]:
        for message in self._inlet.drain():
            kind, name = owner_of(message[1])
            link = self._links.get(name) or self._links.get(kind)
            if link is not None:
                link.send(*message)
        now = self._now()
        arrived = [message for link in self._links.values() for message in link.due(now)]
        return sorted(arrived, key=lambda message: message[0])

    def end(self) -> None:
        self._inlet.end()
