"""A member of the mesh: payloads in and out by channel.

A payload belongs to the owner of the key that it came under: one that speaks for another is
refused, as are bytes that hold none, or too many of them. What is refused is counted by owner.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from operator import attrgetter
from typing import Any, Final, TypeVar

from swarm_ctl.core.model.messages import Command, Refusal, RefusalReason
from swarm_ctl.errors import PayloadError
from swarm_ctl.mesh.gate import Gate, Likely, MeshSource, Refusals, Stations
from swarm_ctl.mesh.keys import Channel
from swarm_ctl.mesh.payloads import decode, encode
from swarm_ctl.mesh.transport import Inlet, Message, Transport

P = TypeVar("P")


class Node:
    """Publishes under its own `name` (an agent's id, a station's name) in `swarm`."""

    def __init__(self, transport: Transport, swarm: str, name: int | str) -> None:
        self._transport = transport
        self._swarm = swarm
        self.name: Final = name
        self.overheard: Callable[[str, bytes], None] | None = None
        """Is given (key, bytes) of each message that is sent, or believed; raises nothing."""
        self._agents: tuple[int, ...] = ()
        self._inlets: dict[str, dict[int | str, Inlet]] = {}
        """By channel; by agent that is followed, or `*`."""
        self._gates: dict[str, Gate] = {}
        self._keys: dict[str, str] = {}
        self._refusals = Refusals()
        self._stations = Stations()

    def listen(self, *channels: Channel[Any], agents: Iterable[int] = ()) -> None:
        """Subscribe to all publishers of these channels. No flood of others takes the place of the
        messages of `agents`, the plan's."""
        self._agents = tuple(agents)
        for channel in channels:
            self._open(channel, ("*",))

    def follow(self, channel: Channel[Any], agents: Iterable[int]) -> None:
        """Subscribe to these agents alone, and end the subscriptions to others. An agent's
        allowance stays: it gets no new one by being followed again."""
        wanted = frozenset(agents)
        known = self._inlets.get(channel.name, {})
        for agent in known.keys() - wanted:
            known.pop(agent).end()
        self._open(channel, sorted(wanted - known.keys()))

    def _open(self, channel: Channel[Any], publishers: Iterable[int | str]) -> None:
        inlets = self._inlets.setdefault(channel.name, {})
        for publisher in publishers:
            key = channel.key(self._swarm, publisher)
            inlets[publisher] = self._transport.subscribe(key, timed=channel.qos.timed)
        if channel.name not in self._gates:
            ids = self._agents if channel.publisher == "agent" else ()
            known = [channel.key(self._swarm, i) for i in ids]
            self._gates[channel.name] = Gate(channel, known, self._refusals, self._stations)

    def send(self, channel: Channel[P], payload: P) -> None:
        """Publish under the own key."""
        key = self._keys.get(channel.name)
        if key is None:
            key = self._keys[channel.name] = channel.key(self._swarm, self.name)
        data = encode(payload)
        self._transport.publish(key, data, channel.qos)
        if self.overheard is not None:
            self.overheard(key, data)

    def take(self, channel: Channel[P], likely: Likely | None = None) -> list[tuple[P, float]]:
        """(payload, received_s [s]) of the messages since the last call, oldest first; those that
        are refused are left out. Of too many under the key of an agent of the plan, those that are
        `likely` have an allowance of their own."""
        messages: list[Message] = []
        for inlet in self._inlets.get(channel.name, {}).values():
            messages += inlet.drain()
        if not messages:
            return []
        gate = self._gates[channel.name]
        taken = []
        speaker = _SPEAKERS[channel.publisher]
        for received_s, source, data in gate.admit(messages, likely):
            try:
                payload: Any = decode(channel.payload, data)
            except PayloadError as error:
                words = f"is unreadable: {error}"
                gate.refuse(source, RefusalReason.UNREADABLE, words, received_s)
                continue
            if isinstance(payload, Command):
                payload = _signed(payload, source)
            said = speaker(payload)
            if said != source.name:
                words = f"says {channel.publisher} {said}"
                gate.refuse(source, RefusalReason.OTHER_OWNER, words, received_s)
            else:
                taken.append((payload, received_s))
                if self.overheard is not None:
                    self.overheard(channel.key(self._swarm, said), data)
        return taken

    @property
    def bad_payloads(self) -> int:
        """Messages that were refused for what they are, so far."""
        return self._refusals.unread

    def refused(self, now: float) -> tuple[Refusal, ...]:
        """What was refused in the last seconds."""
        told = self._refusals.recent(now)
        if any(each.reason is RefusalReason.TOO_MANY for each in told):
            brings = self._transport.busiest()
            told = tuple(_by_links(each, brings) for each in told)
        return (*told, *self._transport.refused(now))

    def close(self) -> None:
        """Leave the mesh."""
        self._transport.close()


_SPEAKERS: Final = {publisher: attrgetter(publisher) for publisher in ("agent", "station")}
"""For whom a payload speaks, by the channel's publisher."""


def _by_links(refusal: Refusal, brings: str) -> Refusal:
    """With the links that bring most, of a flood."""
    if not brings or refusal.reason is not RefusalReason.TOO_MANY:
        return refusal
    return replace(refusal, words=f"{refusal.words}; most comes by {brings}")


def _signed(command: Command, source: MeshSource) -> Command:
    """A sender need not name itself: the key does."""
    return command if command.station else replace(command, station=str(source.name))
