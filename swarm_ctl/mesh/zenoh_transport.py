"""The mesh over zenoh. 100 bytes at 20 Hz between 6 peers cost about 1.5 % CPU.

Explicit endpoints, no multicast and no gossip: each agent connects to the agents with a lower id,
so every pair has one link. Never fork after a session was opened.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from swarm_ctl.errors import StartError
from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.transport import QUEUE, Inlet, QueueInlet, Transport

# One worker thread instead of one pool per task: a quarter less CPU, 6 threads instead of 11.
os.environ.setdefault(
    "ZENOH_RUNTIME",
    "(rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app),app:(worker_threads:1))",
)
import zenoh

_LEASE_S = 3.0
"""Mission time after which zenoh drops a silent link. Agents judge a peer by its state's age."""
_LEAST_LEASE_MS = 1000
"""On the wall clock: a shorter lease would cut links whenever the machine is slow."""
_OPEN_WALL_MS = 3000
"""For one attempt to open a link (zenoh's default: 10 s). After a cut, no link waits for the ever
rarer packets of an old attempt, and a closing session waits no longer than this. Five round trips
of 300 ms and a lost packet fit in."""
_QUEUED, _DROPPED_AFTER_US = 2, 1000
"""Batches that a link queues of each priority, and how long a message waits for a full queue before
it is dropped (zenoh's defaults): the control loop must not wait."""
_PATIENT_QUEUED, _PATIENT_DROPPED_AFTER_US = 16, 1_000_000
"""In lockstep mission time waits for the message. With the defaults, one of 17 flights beside four
busy loops lost two, and was another flight."""


class ZenohTransport(Transport):
    """A zenoh session.

    Args:
        listen: endpoints such as `tcp/127.0.0.1:7447`.
        connect: endpoints, tried until they answer.
        now: the mission clock [s], for the time of receipt.
        speedup: mission seconds per second of the wall clock.
        patient: a message waits for a full queue, up to a second, before it is dropped.

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
    ) -> None:
        self._now = now
        self._publishers: dict[str, Any] = {}
        self._subscribers: list[Any] = []
        try:
            self._session = zenoh.open(_config(listen, connect, speedup, patient))
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


def _config(
    listen: Sequence[str], connect: Sequence[str], speedup: float, patient: bool
) -> zenoh.Config:
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
        "transport/link/tx/queue/size/real_time": _PATIENT_QUEUED if patient else _QUEUED,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": (
            _PATIENT_DROPPED_AFTER_US if patient else _DROPPED_AFTER_US
        ),
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
