"""The mesh over zenoh; the only module that imports it. Figures: 20 Hz of 100 B between 6 peers
costs about 1.5 % CPU.

Explicit endpoints, no multicast and no gossip: agent i connects to the agents with a lower id, so
every pair is linked once. Never fork after a session was opened.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
import struct
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from swarm_ctl.errors import StartError
from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.transport import QUEUE, Inlet

# One worker thread for everything instead of one pool per task: a quarter less CPU, 6 threads
# instead of 11.
os.environ.setdefault(
    "ZENOH_RUNTIME",
    "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),app:(worker_threads:1))",
)
import zenoh

_LEASE_S = 3.0
"""Mission time after which zenoh drops a silent link. Liveness is the agents' own business (state
ages)."""
_LEAST_LEASE_MS = 1000
"""On the wall clock: a shorter one would cut links at every hiccup of the machine."""
_OPEN_WALL_MS = 3000
"""For one attempt at a link (zenoh's own figure: 10 s). After a cut nobody waits for the ever rarer
packets of an old attempt, and a session that closes waits no longer than this; five round trips at
300 ms, and a loss, fit in."""


class ZenohTransport:
    """A zenoh session as a `Transport`.

    Args:
        listen: endpoints such as `tcp/127.0.0.1:7447`; StartError when one is busy.
        connect: endpoints that are tried until they answer.
        now: the mission clock, for the time of receipt.
        speedup: mission seconds per second of the wall clock.
    """

    def __init__(
        self,
        listen: Sequence[str],
        connect: Sequence[str],
        now: Callable[[], float],
        speedup: float = 1.0,
    ) -> None:
        self._now = now
        self._publishers: dict[str, Any] = {}
        self._subscribers: list[Any] = []
        try:
            self._session = zenoh.open(_config(listen, connect, speedup))
        except zenoh.ZError as error:
            why = str(error).split(" at /", 1)[0]  # zenoh appends its own source paths
            raise StartError(
                f"the mesh does not open: {why}; name a free port (`mesh` in the fleet)"
            ) from None
        self._links = self._session.info.declare_link_events_listener(
            lambda _: _forbid_lingering(), history=True
        )

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        """As `Transport.publish`; the publisher of a key is declared on first use."""
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._publishers[key] = self._declare(key, qos)
        publisher.put(data)

    def _declare(self, key: str, qos: Qos) -> Any:
        return self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,  # the control loop never blocks, whatever the payload
            priority=zenoh.Priority.REAL_TIME if qos.urgent else zenoh.Priority.DATA,
            express=qos.urgent,
            reliability=zenoh.Reliability.RELIABLE
            if qos.reliable
            else zenoh.Reliability.BEST_EFFORT,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        """As `Transport.subscribe`."""
        if timed:
            inlet = TimedInlet(self._now)
            self._subscribers.append(
                self._session.declare_subscriber(
                    key_expression, inlet.put, allowed_origin=zenoh.Locality.REMOTE
                )
            )
            return inlet
        # zenoh's ring, polled: a tenth cheaper for the whole process than a callback on zenoh's
        # receive thread
        subscriber = self._session.declare_subscriber(
            key_expression, zenoh.handlers.RingChannel(QUEUE), allowed_origin=zenoh.Locality.REMOTE
        )
        return RingInlet(subscriber, self._now)

    def close(self) -> None:
        """Leave the mesh; what was sent before is flushed, where the other end still takes it."""
        with contextlib.suppress(
            zenoh.ZError
        ):  # a link that nobody answers on: it is closed all the same
            self._session.close()  # type: ignore[no-untyped-call]


class RingInlet:
    """A zenoh subscription with a ring of the newest `QUEUE` samples."""

    def __init__(self, subscriber: Any, now: Callable[[], float]) -> None:
        self._receive = subscriber.try_recv
        self._now = now

    def drain(self) -> list[tuple[float, bytes]]:
        """As `Inlet.drain`; the time of receipt is the time of this call."""
        now = self._now()
        taken = []
        while (sample := self._receive()) is not None:
            taken.append((now, sample.payload.to_bytes()))
        return taken


class TimedInlet:
    """A zenoh subscription whose messages are timed as they come, on a thread of zenoh's. For rare
    ones."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._waiting: deque[tuple[float, bytes]] = deque(maxlen=QUEUE)

    def put(self, sample: Any) -> None:
        """Only hand it over."""
        self._waiting.append((self._now(), sample.payload.to_bytes()))

    def drain(self) -> list[tuple[float, bytes]]:
        """As `Inlet.drain`."""
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken


def _forbid_lingering() -> None:
    """No TCP socket of this process waits in close() for its last bytes to arrive; the kernel sends
    them on without it.

    zenoh has every TCP link wait for 10 s, a constant of its build (SO_LINGER, which blocks even
    where all else does not). The thread that waits is the one that carries all other links: an
    agent whose radio link to some was cut heard and said nothing to anybody, for 10 s with each of
    them.
    """
    for entry in list(Path("/dev/fd").iterdir()):
        with contextlib.suppress(OSError):  # what was closed meanwhile
            if stat.S_ISSOCK(os.fstat(int(entry.name)).st_mode):
                _never_linger(int(entry.name))


def _never_linger(descriptor: int) -> None:
    with socket.socket(fileno=os.dup(descriptor)) as one:
        if one.type == socket.SOCK_STREAM and one.family in (socket.AF_INET, socket.AF_INET6):
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))


def _config(listen: Sequence[str], connect: Sequence[str], speedup: float) -> zenoh.Config:
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "peer",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {
            "period_init_ms": 50,
            "period_max_ms": 500,
            "period_increase_factor": 1.5,
        },
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": max(_LEAST_LEASE_MS, round(_LEASE_S * 1000 / speedup)),
        "transport/unicast/open_timeout": _OPEN_WALL_MS,
        "transport/unicast/accept_timeout": _OPEN_WALL_MS,
        "transport/link/tx/batch_size": 8192,
        "transport/link/rx/buffer_size": 8192,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
