"""A station's messages live to Foxglove, by a websocket of the loopback interface; imported only
when asked for. Clients read; there is nothing that they can send."""

from __future__ import annotations

import json
import logging
import threading
from typing import Final

from foxglove import Capability, Channel, Context, Schema, start_server

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import StartError
from swarm_ctl.recording.topics import TOPICS, Topic
from swarm_ctl.station.foxglove.desk import TOPICS as DESK

HOST: Final = "127.0.0.1"
_WAITING: Final = 2048
"""Messages that wait for a slow client at most; then the oldest are dropped."""
_CLOCK_NS: Final = 50_000_000
_STOP_WALL_S: Final = 5.0
"""For a call that is under way when the server is to end."""


logging.getLogger("foxglove").addHandler(logging.NullHandler())  # stderr may be a dashboard's


class FoxgloveServer:
    """A sink of a recorder that serves on `HOST:port` from now on; StartError where the port is
    taken. The SDK's own threads send: a write never waits for a client."""

    def __init__(self, port: int, plan: Plan) -> None:
        self._context = Context()
        self._channels: dict[tuple[str, int | None], Channel] = {}
        # Before the server: to a client that is there already, the SDK advertises a channel that it
        # may not know yet when the client subscribes.
        for topic in (*TOPICS, *DESK):
            ids = [agent.id for agent in plan.agents] if "{id}" in topic.template else [None]
            for agent in ids:
                self._channel(topic, agent)
        try:
            self._server = start_server(
                name=plan.name,
                host=HOST,
                port=port,
                capabilities=[Capability.Time],
                context=self._context,
                message_backlog_size=_WAITING,
            )
        except RuntimeError as error:
            raise StartError(f"foxglove: {HOST}:{port}: {error}; name another port") from None
        self._clock_ns = 0
        self._calls = threading.Lock()
        """The SDK's server takes one call at a time: `stop` beside another one is a RuntimeError
        ("Already borrowed")."""
        self._closed = False

    def write(
        self, topic: Topic, agent: int | None, heard_ns: int, said_ns: int, data: bytes
    ) -> None:
        """Send to the clients that have subscribed to the topic; the time is the mission's."""
        del said_ns  # the protocol has one time
        if heard_ns >= self._clock_ns + _CLOCK_NS:
            self._clock_ns = heard_ns
            with self._calls:
                if not self._closed:
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
        """Disconnect the clients. The recorder's thread and the station's both end with it, either
        one first."""
        if self._calls.acquire(timeout=_STOP_WALL_S):
            try:
                if not self._closed:
                    self._closed = True
                    self._server.stop()
            finally:
                self._calls.release()

    abandon = close
    """A view that stands still would look like a swarm that does."""
