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
        self._routes: dict[tuple[MemoryTransport, str], list[QueueInlet]] = {}
        """By sender and key: the inlets that get its messages."""

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
        inlets = self._routes.get((sender, key))
        if inlets is None:
            others = [member for member in self.members if member is not sender]
            inlets = [inlet for member in others for inlet in member.inlets(key)]
            self._routes[sender, key] = inlets
        for inlet in inlets:
            inlet.put(received_s, key, data)

    def changed(self) -> None:
        """A member has come or gone, or hears other keys."""
        self._routes.clear()


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
        hub.changed()

    def publish(self, key: str, data: bytes, qos: Qos) -> None:  # noqa: ARG002 - nothing is lost
        self._hub.publish(self, key, data)

    def inlets(self, key: str) -> list[QueueInlet]:
        """The inlets that subscribed to a key."""
        inlets = self._by_key.get(key)
        if inlets is None:
            found = [inlet for pattern, inlet in self._inlets if pattern.fullmatch(key)]
            inlets = self._by_key[key] = found
        return inlets

    def subscribe(self, key_expression: str, *, timed: bool = False) -> QueueInlet:  # noqa: ARG002 - always
        inlet = MemoryInlet(self._forget)
        self._changed()
        self._inlets.append((re.compile(re.escape(key_expression).replace(r"\*", "[^/]+")), inlet))
        return inlet

    def _forget(self, inlet: Inlet) -> None:
        self._changed()
        self._inlets = [known for known in self._inlets if known[1] is not inlet]

    def _changed(self) -> None:
        self._by_key.clear()
        self._hub.changed()

    def close(self) -> None:
        if self in self._hub.members:
            self._hub.members.remove(self)
            self._hub.changed()
