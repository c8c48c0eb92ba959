"""The seam between the mesh and its transport: `zenoh_transport` or `memory_transport`."""

from __future__ import annotations

from collections import deque
from typing import Protocol, TypeAlias

from swarm_ctl.core.model.messages import Refusal
from swarm_ctl.mesh.keys import QUEUE, Qos


class Carried(Protocol):
    """The bytes of a message, copied only when they are asked for."""

    def __len__(self) -> int: ...

    def __bytes__(self) -> bytes: ...


Message: TypeAlias = tuple[float, str, Carried]
"""(received_s [s], key, bytes)."""


class Inlet(Protocol):
    """A subscription, polled by a control loop. A receive thread only puts messages in."""

    def drain(self) -> list[Message]:
        """The messages since the last call, oldest first, at most `QUEUE`. Never blocks."""

    def end(self) -> None:
        """Unsubscribe."""


class QueueInlet(Inlet):
    """A queue of the newest `QUEUE` messages, which another thread may fill."""

    def __init__(self) -> None:
        self._waiting: deque[Message] = deque(maxlen=QUEUE)

    def put(self, received_s: float, key: str, data: Carried) -> None:
        """Add a message."""
        self._waiting.append((received_s, key, data))

    def drain(self) -> list[Message]:
        waiting = self._waiting
        # Not more than wait now: the other thread may add as fast as this one takes.
        return [waiting.popleft() for _ in range(len(waiting))] if waiting else []

    def end(self) -> None:
        """Take no more."""
        self._waiting = deque(maxlen=0)


class Transport(Protocol):
    """Publish and subscribe by key; a member does not get its own messages."""

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        """Send without blocking."""

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        """All messages under keys that match (`*` stands for one part), until the inlet is ended.

        `timed`: `received_s` is when a message came; otherwise it may be the time of `drain`.
        """

    def refused(self, now: float) -> tuple[Refusal, ...]:  # noqa: ARG002
        """Links that were ended in the last seconds before `now` [s]; by default none is."""
        return ()

    def busiest(self) -> str:
        """The links that bring most bytes, since the last call; '': that is not known."""
        return ""

    def close(self) -> None:
        """Leave the mesh."""
