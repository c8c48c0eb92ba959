"""What the mesh needs of a transport. Implementations: `zenoh_transport` (real), `memory_transport` (in process)."""

from __future__ import annotations

from collections import deque
from typing import Protocol

from swarm_ctl.mesh.keys import Qos

QUEUE = 4096
"""Messages a subscription keeps for a reader that does not come; the oldest go first."""


class Inlet:
    """Where a transport's receive thread puts what it hears, and a control loop picks it up. Never blocks."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, bytes]] = deque(maxlen=QUEUE)
        self.dropped = 0

    def put(self, received_s: float, data: bytes) -> None:
        """Called on the transport's thread: only hand over."""
        if len(self._waiting) == QUEUE:
            self.dropped += 1
        self._waiting.append((received_s, data))

    def drain(self) -> list[tuple[float, bytes]]:
        """Everything that came since the last call, oldest first: (received_s, bytes)."""
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken


class Transport(Protocol):
    """Publish and subscribe by key; own messages are not delivered to oneself."""

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        """Send without waiting."""

    def subscribe(self, key_expression: str) -> Inlet:
        """Everything published under keys that match (`*` stands for one part)."""

    def close(self) -> None:
        """Leave the mesh."""
