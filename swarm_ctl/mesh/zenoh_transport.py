"""The mesh over zenoh. 100 bytes at 20 Hz between 6 peers cost about 1.5 % CPU.

Explicit endpoints, no multicast and no gossip: each agent connects to the agents with a lower id,
so every pair has one link. Never fork after a session was opened.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import zenoh

from swarm_ctl.errors import StartError
from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.transport import QUEUE, Inlet, QueueInlet, Transport
from swarm_ctl.mesh.zenoh_config import configuration


class ZenohTransport(Transport):
    """A zenoh session.

    Args:
        listen: endpoints such as `tcp/127.0.0.1:7447`.
        connect: endpoints, tried until they answer.
        now: the mission clock [s], for the time of receipt.
        speedup: mission seconds per second of the wall clock.
        patient: a message waits for a full queue, up to a second, before it is dropped.
        access: of a protected mesh (`access.access_settings`); None: the mesh is open.

    Raises:
        StartError: an endpoint to listen at is busy.
    """

    def __init__(
        self,
        listen: Sequence[str],
        connect: Sequence[str],
        now: Callable[[], float],
        speedup: float = 1.0,
        *,
        patient: bool = False,
        access: Mapping[str, Any] | None = None,
    ) -> None:
        self._now = now
        self._publishers: dict[str, Any] = {}
        self._subscribers: list[Any] = []
        try:
            self._session = zenoh.open(
                configuration(listen, connect, speedup, patient=patient, access=access)
            )
        except zenoh.ZError as error:
            why = str(error).split(" at /", 1)[0]  # zenoh appends its own source paths
            raise StartError(
                f"the mesh does not open: {why}; name a free port (`mesh` in the fleet)"
            ) from None
        self._links = self._session.info.declare_link_events_listener(
            lambda _: _forbid_lingering(), history=True
        )

    def publish(self, key: str, data: bytes, qos: Qos, mark: bytes = b"") -> None:
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._publishers[key] = self._declare(key, qos)
        publisher.put(data, attachment=mark or None)

    def _declare(self, key: str, qos: Qos) -> Any:
        reliability = zenoh.Reliability
        return self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,  # the control loop must not wait long
            priority=zenoh.Priority.REAL_TIME if qos.urgent else zenoh.Priority.DATA,
            express=qos.urgent,
            reliability=reliability.RELIABLE if qos.reliable else reliability.BEST_EFFORT,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        elsewhere = zenoh.Locality.REMOTE
        declare = self._session.declare_subscriber
        if not timed:
            # zenoh's ring, polled, costs a tenth less CPU than a callback on zenoh's thread.
            ring: Any = zenoh.handlers.RingChannel(QUEUE)
            return RingInlet(declare(key_expression, ring, allowed_origin=elsewhere), self._now)
        inlet = QueueInlet()

        def put(sample: Any) -> None:
            inlet.put(self._now(), sample.payload.to_bytes())

        self._subscribers.append(declare(key_expression, put, allowed_origin=elsewhere))
        return inlet

    def subscribe_marked(self, key_expression: str) -> Callable[[], tuple[bytes, bytes] | None]:
        ring: Any = zenoh.handlers.RingChannel(QUEUE)
        remote = zenoh.Locality.REMOTE
        declared = self._session.declare_subscriber(key_expression, ring, allowed_origin=remote)
        receive = declared.try_recv

        def take() -> tuple[bytes, bytes] | None:
            sample: Any = receive()
            if sample is None:
                return None
            mark = sample.attachment
            return sample.payload.to_bytes(), b"" if mark is None else mark.to_bytes()

        return take

    def close(self) -> None:
        """Leave the mesh; flushes what the other ends still accept."""
        # The error tells of a link that no process answers on; it is closed all the same.
        with contextlib.suppress(zenoh.ZError):
            self._session.close()  # type: ignore[no-untyped-call]


class RingInlet(Inlet):
    """A zenoh subscription with a ring of the newest `QUEUE` samples; received at `drain`."""

    def __init__(self, subscriber: Any, now: Callable[[], float]) -> None:
        self._receive = subscriber.try_recv
        self._now = now

    def drain(self) -> list[tuple[float, bytes]]:
        now = self._now()
        taken = []
        while (sample := self._receive()) is not None:
            taken.append((now, sample.payload.to_bytes()))
        return taken


def _forbid_lingering() -> None:
    """Make close() of this process's TCP sockets return at once; the kernel sends the last bytes.

    zenoh sets SO_LINGER to 10 s on every TCP link, a constant of its build, which blocks even a
    non-blocking socket. The blocked thread carries all other links, too: an agent whose radio link
    to one peer was cut exchanged no message with any peer for 10 s.
    """
    for entry in list(Path("/dev/fd").iterdir()):
        with contextlib.suppress(OSError):  # closed meanwhile
            if stat.S_ISSOCK(os.fstat(int(entry.name)).st_mode):
                _never_linger(int(entry.name))


def _never_linger(descriptor: int) -> None:
    with socket.socket(fileno=os.dup(descriptor)) as one:
        if one.type == socket.SOCK_STREAM and one.family in (socket.AF_INET, socket.AF_INET6):
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))
