"""A station's messages live to Foxglove, by a websocket of the loopback interface; imported only
when asked for. Clients read; there is nothing that they can send."""

from __future__ import annotations

import json
from typing import Any, Final

from foxglove import Capability, Channel, Context, Schema, start_server

from swarm_ctl.errors import StartError
from swarm_ctl.recording.topics import Topic

HOST: Final = "127.0.0.1"
_WAITING: Final = 2048
"""Messages that wait for a slow client at most; then the oldest are dropped."""
_CLOCK_NS: Final = 50_000_000


class FoxgloveServer:
    """A sink of a recorder that serves on `HOST:port` from now on; StartError where the port is
    taken. The SDK's own threads send: a write never waits for a client."""

    def __init__(self, port: int, name: str) -> None:
        self._context = Context()
        try:
            self._server = start_server(
                name=name,
                host=HOST,
                port=port,
                capabilities=[Capability.Time],
                context=self._context,
                message_backlog_size=_WAITING,
            )
        except RuntimeError as error:
            raise StartError(f"foxglove: {HOST}:{port}: {error}; name another port") from None
        self._channels: dict[tuple[str, int | None], Any] = {}
        self._clock_ns = 0

    def write(
        self, topic: Topic, agent: int | None, heard_ns: int, said_ns: int, data: bytes
    ) -> None:
        """Send to the clients that have subscribed to the topic; the time is the mission's."""
        del said_ns  # the protocol has one time
        channel = self._channels.get((topic.name, agent))
        if channel is None:
            schema = Schema(
                name=topic.schema["title"],
                encoding="jsonschema",
                data=json.dumps(topic.schema).encode(),
            )
            channel = self._channels[topic.name, agent] = Channel(
                topic.template.format(id=agent),
                schema=schema,
                message_encoding="json",
                context=self._context,
            )
        if heard_ns >= self._clock_ns + _CLOCK_NS:
            self._clock_ns = heard_ns
            self._server.broadcast_time(heard_ns)
        channel.log(data, log_time=heard_ns)

    def flush(self) -> None:
        """Nothing waits here."""

    def close(self) -> None:
        """Disconnect the clients."""
        self._server.stop()

    abandon = close
    """A view that stands still would look like a swarm that does."""
