"""The mesh inside one process, for whole swarms on a virtual clock: delivery is immediate and lossless."""

from __future__ import annotations

import re
from collections.abc import Callable

from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.transport import Inlet


class MemoryHub:
    """What all `MemoryTransport`s of one mesh share; `now` is the virtual clock."""

    def __init__(self, now: Callable[[], float]) -> None:
        self.now = now
        self.members: list[MemoryTransport] = []


class MemoryTransport:
    """One member of a `MemoryHub`."""

    def __init__(self, hub: MemoryHub) -> None:
        self._hub = hub
        self._inlets: list[tuple[re.Pattern[str], Inlet]] = []
        hub.members.append(self)

    def publish(self, key: str, data: bytes, qos: Qos) -> None:  # noqa: ARG002 - nothing is ever lost here
        """Hand over to every other member that listens."""
        for member in self._hub.members:
            if member is not self:
                member.deliver(key, data)

    def deliver(self, key: str, data: bytes) -> None:
        """Take one message in."""
        for pattern, inlet in self._inlets:
            if pattern.fullmatch(key):
                inlet.put(self._hub.now(), data)

    def subscribe(self, key_expression: str) -> Inlet:
        """As `Transport.subscribe`."""
        inlet = Inlet()
        self._inlets.append((re.compile(re.escape(key_expression).replace(r"\*", "[^/]+")), inlet))
        return inlet

    def close(self) -> None:
        """Leave the hub: nothing is heard from or sent to this member any more."""
        if self in self._hub.members:
            self._hub.members.remove(self)
