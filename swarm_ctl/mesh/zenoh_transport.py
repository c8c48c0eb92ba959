"""The mesh over zenoh. 100 bytes at 20 Hz between 6 peers cost about 1.5 % CPU.

Explicit endpoints, no multicast and no gossip. In a small swarm each agent connects to the agents
with a lower id, so every pair has one link; in a large one all are clients of their host's router.
Never fork after a session was opened.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import zenoh

from swarm_ctl.core.model.messages import Refusal
from swarm_ctl.errors import StartError
from swarm_ctl.mesh.gate import MeshSource
from swarm_ctl.mesh.keys import CHANNELS, QUEUE, Bounds, Qos
from swarm_ctl.mesh.late_session import LateSession
from swarm_ctl.mesh.links import Links
from swarm_ctl.mesh.payloads import is_json
from swarm_ctl.mesh.stepped_transport import MARK_SIZE, Marked, MarkedSource
from swarm_ctl.mesh.transport import Inlet, Message, QueueInlet, Transport
from swarm_ctl.mesh.zenoh_config import MeshPart, configuration

_FLOOD: Final = 256
"""Samples between two drains of a timed subscription: ten times what 50 agents send in a tick while
they ask for each other's clocks."""
_OF_ONE: Final = 64
"""Samples that wait of one publisher that is subscribed to alone."""
_ENCODINGS: Final = {
    channel.name: zenoh.Encoding.APPLICATION_JSON
    for channel in CHANNELS
    if is_json(channel.payload)
}
"""Of the channels that foreign tools can read by it; the others' bytes are this project's own, and
zenoh says nothing of them."""
_ANSWERS: Final = Bounds(0, 50.0, 250)
"""A second, of one process: each agent of the largest swarm asks once a second."""
_ANSWER_WALL_S: Final = 10.0
"""For an answer over a slow link."""
_CALM_S: Final = 10.0
"""Without a flood, before samples are stamped again."""
_NO_ROUTER: Final = "Unable to connect"
"""zenoh's words for it."""
_CONTROL: Final = b"bbr"
_TCP_RTO_MAX_MS: Final = 44
"""From linux/tcp.h, since Linux 6.15; not in the socket module."""
_REPEATED_MS: Final = 1000
"""The least that the kernel takes. By default the pause doubles up to 120 s."""


class ZenohTransport(Transport):
    """A zenoh session.

    Args:
        listen: endpoints such as `tcp/127.0.0.1:7447`.
        connect: endpoints, tried until they answer.
        now: the mission clock [s], for the time of receipt.
        speedup: mission seconds per second of the wall clock.
        patient: a message waits for a full queue, up to a second, before it is dropped.
        access: of a protected mesh (`access.access_settings`); None: the mesh is open.
        part: what this process is on the mesh. A client says and hears nothing before its router
            answers, as on a mesh that is cut.
        alive: the key of its liveliness token; '': it has none.
        own: a user's own zenoh settings (`zenoh_config.read_settings`).

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
        part: MeshPart = MeshPart.PEER,
        alive: str = "",
        own: Mapping[str, Any] | None = None,
    ) -> None:
        self._now = now
        self._express = part is MeshPart.PEER
        self._publishers: dict[str, Any] = {}
        self._kept: list[Any] = []
        config = configuration(
            listen, connect, speedup, patient=patient, access=access, part=part, own=own
        )
        if part is MeshPart.CLIENT:
            self._session: Any = LateSession(lambda: _open_to_router(config))
        else:
            self._session = _open(config)
        self._links = Links(now, _tend_socket)
        self._listener = _tend_links(self._session, self._links)
        _show(self._session, alive, self._kept)

    def refused(self, now: float) -> tuple[Refusal, ...]:
        return self._links.refused(now)

    def busiest(self) -> str:
        return self._links.busiest()

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
            # a router loses nine tenths of what a hundred express publishers send
            express=qos.urgent and self._express,
            reliability=reliability.RELIABLE if qos.reliable else reliability.BEST_EFFORT,
            encoding=_ENCODINGS.get(key.rpartition("/")[2]),
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        declare = self._declaring(key_expression)
        if timed:
            return TimedInlet(declare, self._now, lambda: _ring(key_expression))
        return RingInlet(declare(_ring(key_expression)), self._now)

    def subscribe_marked(self, key_expression: str) -> MarkedSource:
        subscriber = self._declaring(key_expression)(_ring(key_expression))
        receive = subscriber.try_recv

        def take() -> Marked | None:
            sample: Any = receive()
            if sample is None:
                return None
            mark = sample.attachment
            small = mark is not None and len(mark) <= MARK_SIZE
            return str(sample.key_expr), sample.payload, mark.to_bytes() if small else b""

        return MarkedSource(take, subscriber.undeclare)

    def serve(self, key: str, data: bytes) -> None:
        """Answer those that ask for `key` with `data`, by zenoh's thread."""
        asked = MeshSource("", key, _ANSWERS)

        def answer(query: Any) -> None:
            with query:
                if asked.admit(self._now()):
                    query.reply(key, data, encoding="application/gzip")

        self._kept.append(self._session.declare_queryable(key, answer))

    def ask(self, key_expression: str, take: Callable[[str, bytes], None]) -> None:
        """Ask all that serve a key that matches; `take` gets each answer, on zenoh's thread."""

        def hear(reply: Any) -> None:
            if reply.ok is not None:
                take(str(reply.ok.key_expr), reply.ok.payload.to_bytes())

        self._session.get(
            key_expression,
            hear,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_ANSWER_WALL_S,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def _declaring(self, key_expression: str) -> Callable[[Any], Any]:
        """What subscribes with a handler: a callback or a ring."""
        declare, elsewhere = self._session.declare_subscriber, zenoh.Locality.REMOTE
        return lambda handler: declare(key_expression, handler, allowed_origin=elsewhere)

    def close(self) -> None:
        """Leave the mesh; flushes what the other ends still accept."""
        _close(self._session, self._listener)
        self._links.close()


def _open(config: zenoh.Config) -> Any:
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        why = str(error).split(" at /", 1)[0]  # zenoh appends its own source paths
        raise StartError(
            f"the mesh does not open: {why}; name a free port (`mesh` in the fleet)"
        ) from None


def _open_to_router(config: zenoh.Config) -> Any:
    """A client's session; None: no router has taken it in yet."""
    try:
        return _open(config)
    except StartError as error:
        if _NO_ROUTER in str(error):
            return None
        raise


def _tend_links(session: Any, links: Links) -> Any:
    """Look after the session's links whenever one comes or goes, until `_close`."""

    def tend(event: Any) -> None:
        links.heard(event.link, ended=event.kind == zenoh.SampleKind.DELETE)

    return session.info.declare_link_events_listener(tend, history=True)


def _close(session: Any, listener: Any) -> None:
    """First the listener: a call of it while the interpreter ends would abort the process."""
    with contextlib.suppress(zenoh.ZError):
        listener.undeclare()
    # The error tells of a link that no process answers on; it is closed all the same.
    with contextlib.suppress(zenoh.ZError):
        session.close()


def _show(session: Any, alive: str, kept: list[Any]) -> None:
    """Let other tools see that this process is there. zenoh ends a token that Python forgets."""
    if alive:
        kept.append(session.liveliness().declare_token(alive))


class Router:
    """A zenoh session that passes on what its clients and other routers say.

    Args: as of `ZenohTransport`.
    """

    def __init__(
        self,
        listen: Sequence[str],
        connect: Sequence[str],
        speedup: float = 1.0,
        *,
        patient: bool = False,
        access: Mapping[str, Any] | None = None,
        alive: str = "",
        own: Mapping[str, Any] | None = None,
    ) -> None:
        config = configuration(
            listen, connect, speedup, patient=patient, access=access, part=MeshPart.ROUTER, own=own
        )
        self._kept: list[Any] = []
        self._session = _open(config)
        self._links = Links(tend=_tend_socket)
        self._listener = _tend_links(self._session, self._links)
        _show(self._session, alive, self._kept)

    def refused(self, now: float) -> tuple[Refusal, ...]:
        """Links of members that have too many, in the last seconds before `now` [s]."""
        return self._links.refused(now)

    def clients(self) -> int:
        """So many processes are linked to it, but for other routers."""
        return sum(each.whatami == zenoh.WhatAmI.CLIENT for each in self._session.info.transports())

    def close(self) -> None:
        """End all its links."""
        _close(self._session, self._listener)
        self._links.close()


_QUEUES: Final = {channel.name: channel.bounds.queue for channel in CHANNELS}


def _ring(key_expression: str) -> Any:
    """zenoh's ring of the newest samples. Polling it costs a tenth less CPU than a callback on
    zenoh's thread, and a flood costs Python nothing before it is polled."""
    size = _QUEUES.get(key_expression.rpartition("/")[2], QUEUE)
    return zenoh.handlers.RingChannel(size if "*" in key_expression else min(size, _OF_ONE))


class RingInlet(Inlet):
    """A polled zenoh subscription; received at the end of `drain`: a control loop that is stopped
    while it reads hears nothing from the future."""

    def __init__(self, subscriber: Any, now: Callable[[], float]) -> None:
        self._receive = subscriber.try_recv
        self._now = now
        self._undeclare = subscriber.undeclare

    def drain(self) -> list[Message]:
        samples: list[Any] = []
        while len(samples) < QUEUE and (sample := self._receive()) is not None:
            samples.append(sample)
        now = self._now()
        return [(now, str(sample.key_expr), sample.payload) for sample in samples]

    def end(self) -> None:
        self._undeclare()


class TimedInlet(Inlet):
    """A zenoh subscription that stamps each sample when it comes, by a callback on zenoh's thread.
    While there are too many, it is polled: callbacks would take the interpreter from the control
    loop. The time of receipt is then late by a tick at most, which loosens a clock's bounds and
    makes none of them wrong."""

    def __init__(
        self, declare: Callable[[Any], Any], now: Callable[[], float], ring: Callable[[], Any]
    ) -> None:
        self._declare, self._now, self._ring = declare, now, ring
        self._queue = QueueInlet()
        self._inlet: Inlet = self._queue
        self._subscriber = declare(self._put)
        self._flooded_s = 0.0

    def _put(self, sample: Any) -> None:
        self._queue.put(self._now(), str(sample.key_expr), sample.payload)

    def drain(self) -> list[Message]:
        taken = self._inlet.drain()
        now, many, stamped = self._now(), len(taken) > _FLOOD, self._inlet is self._queue
        if many:
            self._flooded_s = now
        if many and stamped:
            polled = self._declare(self._ring())
            self._inlet = RingInlet(polled, self._now)
            self._replace(polled)
            taken += self._queue.drain()
        elif not stamped and not many and now - self._flooded_s > _CALM_S:
            self._inlet = self._queue
            self._replace(self._declare(self._put))
        return taken

    def end(self) -> None:
        self._subscriber.undeclare()

    def _replace(self, subscriber: Any) -> None:
        self._subscriber.undeclare()
        self._subscriber = subscriber


def _tend_socket(one: socket.socket) -> None:
    """Set what zenoh does not let choose on a TCP link."""
    _never_linger(one)
    if sys.platform == "linux" and not _stays_here(one):
        _bear_loss(one)


def _never_linger(one: socket.socket) -> None:
    """Make close() return at once; the kernel sends the last bytes.

    zenoh sets SO_LINGER to 10 s on every TCP link, a constant of its build, which blocks even a
    non-blocking socket. The blocked thread carries all other links, too: an agent whose radio link
    to one peer was cut exchanged no message with any peer for 10 s.
    """
    one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))


def _stays_here(one: socket.socket) -> bool:
    """Both ends are on this host; a socket that listens may be far."""
    with contextlib.suppress(OSError, ValueError):
        return ipaddress.ip_address(one.getpeername()[0]).is_loopback
    return False


def _bear_loss(one: socket.socket) -> None:
    """Keep sending where packets are lost. Linux's usual control, cubic, takes each loss for a full
    link: with a fifth lost, states come up to 12 s late. BBR measures the link instead. The kernel
    may not have it, or not for every user; nor has each the bound of the pause before a repeat."""
    with contextlib.suppress(OSError):
        one.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, _CONTROL)
    with contextlib.suppress(OSError):
        one.setsockopt(socket.IPPROTO_TCP, _TCP_RTO_MAX_MS, _REPEATED_MS)
