"""The mesh inside one process, for swarms on a virtual clock: immediate and lossless."""

from __future__ import annotations

import re
from collections.abc import Callable

from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.transport import QueueInlet, Transport


class MemoryHub:
    """Joins the `MemoryTransport`s of one mesh; `now` is the virtual clock [s]."""

    def __init__(self, now: Callable[[], float]) -> None:
        self.now = now
        self.members: list[MemoryTransport] = []


class MemoryTransport(Transport):
    """One member of a `MemoryHub`."""

    def __init__(self, hub: MemoryHub) -> None:
        self._hub = hub
        self._inlets: list[tuple[re.Pattern[str], QueueInlet]] = []
        self._by_key: dict[str, list[QueueInlet]] = {}
        hub.members.append(self)

    def publish(self, key: str, data: bytes, qos: Qos) -> None:  # noqa: ARG002 - nothing is lost
        for member in self._hub.members:
            if member is not self:
                member.deliver(key, data)

    def deliver(self, key: str, data: bytes) -> None:
        """Put a message into the inlets that subscribed to its key."""
        inlets = self._by_key.get(key)
        if inlets is None:
            found = [inlet for pattern, inlet in self._inlets if pattern.fullmatch(key)]
            inlets = self._by_key[key] = found
        for inlet in inlets:
            inlet.put(self._hub.now(), data)

    def subscribe(self, key_expression: str, *, timed: bool = False) -> QueueInlet:  # noqa: ARG002 - always
        inlet = QueueInlet()
        self._by_key.clear()
        self._inlets.append((re.compile(re.escape(key_expression).replace(r"\*", "[^/]+")), inlet))
        return inlet

    def close(self) -> None:
        if self in self._hub.members:
            self._hub.members.remove(self)
