"""The mesh inside one process, for swarms on a virtual clock: immediate and lossless."""

from __future__ import annotations

import re
from collections.abc import Callable

from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.transport import Inlet, QueueInlet, Transport


class MemoryHub:
    """Joins the `MemoryTransport`s of one mesh; `now` is the virtual clock [s]. With `held`,
    messages wait for `deliver`, as in lockstep they wait for the next tick."""

    def __init__(self, now: Callable[[], float], *, held: bool = False) -> None:
        self.now = now
        self.members: list[MemoryTransport] = []
        self.tap: Callable[[str, bytes], None] | None = None
        """Is given each message once, in the order of sending."""
        self._held: list[tuple[MemoryTransport, str, bytes, float]] | None = [] if held else None

    def publish(self, sender: MemoryTransport, key: str, data: bytes) -> None:
        """Give a message to all others, or keep it."""
        if self.tap is not None:
            self.tap(key, data)
        if self._held is None:
            self._give(sender, key, data, self.now())
        else:
            self._held.append((sender, key, data, self.now()))

    def deliver(self) -> None:
        """Give out what is held."""
        if self._held:
            held, self._held = self._held, []
            for message in held:
                self._give(*message)

    def _give(self, sender: MemoryTransport, key: str, data: bytes, received_s: float) -> None:
        for member in self.members:
            if member is not sender:
                member.deliver(key, data, received_s)


class MemoryInlet(QueueInlet):
    """A subscription of a `MemoryTransport`."""

    def __init__(self, end: Callable[[Inlet], None]) -> None:
        super().__init__()
        self._end = end

    def end(self) -> None:
        self._end(self)


class MemoryTransport(Transport):
    """One member of a `MemoryHub`."""

    def __init__(self, hub: MemoryHub) -> None:
        self._hub = hub
        self._inlets: list[tuple[re.Pattern[str], QueueInlet]] = []
        self._by_key: dict[str, list[QueueInlet]] = {}
        hub.members.append(self)

    def publish(self, key: str, data: bytes, qos: Qos) -> None:  # noqa: ARG002 - nothing is lost
        self._hub.publish(self, key, data)

    def deliver(self, key: str, data: bytes, received_s: float) -> None:
        """Put a message into the inlets that subscribed to its key."""
        inlets = self._by_key.get(key)
        if inlets is None:
            found = [inlet for pattern, inlet in self._inlets if pattern.fullmatch(key)]
            inlets = self._by_key[key] = found
        for inlet in inlets:
            inlet.put(received_s, key, data)

    def subscribe(self, key_expression: str, *, timed: bool = False) -> QueueInlet:  # noqa: ARG002 - always
        inlet = MemoryInlet(self._forget)
        self._by_key.clear()
        self._inlets.append((re.compile(re.escape(key_expression).replace(r"\*", "[^/]+")), inlet))
        return inlet

    def _forget(self, inlet: Inlet) -> None:
        self._by_key.clear()
        self._inlets = [known for known in self._inlets if known[1] is not inlet]

    def close(self) -> None:
        if self in self._hub.members:
            self._hub.members.remove(self)
