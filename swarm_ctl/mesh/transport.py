"""What the mesh needs of a transport. Implementations: `zenoh_transport` (real), `memory_transport`
(in process)."""

from __future__ import annotations

from typing import Protocol

from swarm_ctl.mesh.keys import Qos

QUEUE = 4096
"""Messages a subscription keeps for a reader that does not come; the oldest go first (seen as gaps
in `seq`)."""


class Inlet(Protocol):
    """A subscription, polled by a control loop. The transport's receive thread only hands over."""

    def drain(self) -> list[tuple[float, bytes]]:
        """Everything that came since the last call, oldest first: (received_s, bytes). Never
        blocks."""


class Transport(Protocol):
    """Publish and subscribe by key; own messages are not delivered to oneself."""

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        """Send without waiting."""

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        """Everything published under keys that match (`*` stands for one part).

        `timed`: the time of receipt has to be when a message came; else that of the next `drain`
        will do.
        """

    def close(self) -> None:
        """Leave the mesh."""
