"""A station's messages live to Foxglove, by a websocket of the loopback interface. Clients read;
there is nothing that they can send."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import secrets
import socket
import sys
import threading
from typing import Final

from foxglove import Capability, Channel, Context, Schema, start_server

from swarm_ctl.engine.local_server import SEND_WALL_S, LocalServer, port_of, refuse_taken
from swarm_ctl.errors import SwarmError
from swarm_ctl.extension import Extension, StationHandle
from swarm_ctl.recording.topics import TOPICS, Topic
from swarm_ctl.station.foxglove.desk import TOPICS as DESK

_WAITING: Final = 2048
"""Messages that wait for a slow client at most; then the oldest are dropped."""
_CLOCK_NS: Final = 50_000_000
_INNER_WALL_S: Final = 5.0
_PAGES: Final = re.compile(r"file://|https://([a-z0-9-]+\.)*foxglove\.dev")
ORIGINS: Final = "SWARM_CTL_FOXGLOVE_ORIGINS"
"""The environment's word for more origins, with commas between them."""
_PORT: Final = "8765"
"""Foxglove's own default."""


logging.getLogger("foxglove").addHandler(logging.NullHandler())  # stderr may be a dashboard's


class FoxgloveServer(Extension):
    """Serves on a port of 127.0.0.1, its argument. The SDK's own threads send: a write never waits
    for a client."""

    def __init__(self, argument: str, station: StationHandle) -> None:
        plan, self.sink = station.plan, self
        self._context = Context()
        self._inner = _inner_host()
        self._channels: dict[tuple[str, int | None], Channel] = {}
        # Before the server: to a client that is there already, the SDK advertises a channel that it
        # may not know yet when the client subscribes.
        for topic in (*TOPICS, *DESK):
            ids = [agent.id for agent in plan.agents] if "{id}" in topic.template else [None]
            for agent in ids:
                self._channel(topic, agent)
        self._server = start_server(
            name=plan.name,
            host=self._inner,
            port=0,
            capabilities=[Capability.Time],
            context=self._context,
            message_backlog_size=_WAITING,
        )
        try:
            port = port_of("foxglove", argument or _PORT)
            self._door = LocalServer("foxglove", port, self._pass_on, _may_ask)
        except SwarmError:
            self._server.stop()
            raise
        self._clock_ns = 0
        self._closed = False

    @classmethod
    def check(cls, argument: str) -> None:
        refuse_taken(cls.port(argument), "foxglove")

    @classmethod
    def port(cls, argument: str) -> int:
        return port_of("foxglove", argument or _PORT)

    def _pass_on(self, client: socket.socket, head: bytes) -> None:
        """Between a client that may ask and the SDK's own server, until one of them ends. Blocks
        where the client does not read, so that the SDK drops what it has for it."""
        with socket.create_connection((self._inner, self._server.port), _INNER_WALL_S) as inner:
            inner.sendall(head)
            inner.settimeout(SEND_WALL_S)
            client.settimeout(SEND_WALL_S)
            back = threading.Thread(target=_copy, args=(client, inner), daemon=True)
            back.start()
            _copy(inner, client)
            for each in (inner, client):
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
            back.join()

    def write(
        self, topic: Topic, agent: int | None, heard_ns: int, said_ns: int, data: bytes
    ) -> None:
        """Send to the clients that have subscribed to the topic; the time is the mission's."""
        del said_ns  # the protocol has one time
        if heard_ns >= self._clock_ns + _CLOCK_NS:
            self._clock_ns = heard_ns
            self._server.broadcast_time(heard_ns)
        self._channel(topic, agent).log(data, log_time=heard_ns)

    def _channel(self, topic: Topic, agent: int | None) -> Channel:
        found = self._channels.get((topic.name, agent))
        if found is None:
            schema = topic.schema()
            data = json.dumps(schema).encode()
            found = self._channels[topic.name, agent] = Channel(
                topic.template.format(id=agent),
                schema=Schema(name=schema["title"], encoding="jsonschema", data=data),
                message_encoding="json",
                context=self._context,
            )
        return found

    def flush(self) -> None:
        """Nothing waits here."""

    def close(self) -> None:
        """Disconnect the clients: a view that stands still would look like a swarm that does. Also
        called as a sink's."""
        if not self._closed:
            self._closed = True
            self._door.close()
            self._server.stop()

    abandon = close


def _copy(source: socket.socket, target: socket.socket) -> None:
    """Until one of them ends, or `target` takes nothing for its timeout. A `source` may say nothing
    for as long as it likes: a client that only reads does."""
    with contextlib.suppress(OSError):
        while data := _next(source):
            target.sendall(data)
    with contextlib.suppress(OSError):
        target.shutdown(socket.SHUT_WR)


def _next(source: socket.socket) -> bytes:
    """What it says next; empty at its end."""
    while True:
        # its timeout is that of what is sent to it, by another thread
        with contextlib.suppress(TimeoutError):
            return source.recv(65536)


def _inner_host() -> str:
    """Where the SDK's own server is, which asks no one who it is: on Linux at an address of the
    loopback interface that a page would have to guess, one of 16 million."""
    if sys.platform != "linux":
        return "127.0.0.1"
    a, b, c = (secrets.randbelow(254) + 1 for _ in range(3))
    return f"127.{a}.{b}.{c}"


def _may_ask(origin: str) -> bool:
    """Foxglove's own pages, its desktop program, and the pages that the user names."""
    named = os.environ.get(ORIGINS, "").split(",")
    return _PAGES.fullmatch(origin) is not None or (origin != "null" and origin in named)
