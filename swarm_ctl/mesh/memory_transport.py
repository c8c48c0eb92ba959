"""The mesh inside one process, for whole swarms on a virtual clock: delivery is immediate and
lossless."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable

from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.transport import QUEUE


class MemoryHub:
    """What all `MemoryTransport`s of one mesh share; `now` is the virtual clock."""

    def __init__(self, now: Callable[[], float]) -> None:
        self.now = now
        self.members: list[MemoryTransport] = []


class MemoryInlet:
    """A queue."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, bytes]] = deque(maxlen=QUEUE)

    def put(self, received_s: float, data: bytes) -> None:
        """Keep it for the reader."""
        self._waiting.append((received_s, data))

    def drain(self) -> list[tuple[float, bytes]]:
        """As `Inlet.drain`."""
        taken = list(self._waiting)
        self._waiting.clear()
        return taken


class MemoryTransport:
    """One member of a `MemoryHub`."""

    def __init__(self, hub: MemoryHub) -> None:
        self._hub = hub
        self._inlets: list[tuple[re.Pattern[str], MemoryInlet]] = []
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

    def subscribe(self, key_expression: str, *, timed: bool = False) -> MemoryInlet:  # noqa: ARG002 - always is
        """As `Transport.subscribe`."""
        inlet = MemoryInlet()
        self._inlets.append((re.compile(re.escape(key_expression).replace(r"\*", "[^/]+")), inlet))
        return inlet

    def close(self) -> None:
        """Leave the hub: nothing is heard from or sent to this member any more."""
        if self in self._hub.members:
            self._hub.members.remove(self)
