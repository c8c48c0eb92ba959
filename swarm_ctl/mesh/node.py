"""A member of the mesh: payloads in and out by channel; bad bytes are counted and dropped."""

from __future__ import annotations

from typing import Any, Final, TypeVar

from swarm_ctl.errors import PayloadError
from swarm_ctl.mesh.keys import Channel
from swarm_ctl.mesh.payloads import decode, encode
from swarm_ctl.mesh.transport import Inlet, Transport

P = TypeVar("P")


class Node:
    """Publishes under its own `name` (an agent's id, a station's name) in `swarm`."""

    def __init__(self, transport: Transport, swarm: str, name: int | str) -> None:
        self._transport = transport
        self._swarm = swarm
        self.name: Final = name
        self._inlets: dict[str, Inlet] = {}
        self._keys: dict[str, str] = {}
        self.bad_payloads = 0
        self.last_bad = ""

    def listen(self, *channels: Channel[Any]) -> None:
        """Subscribe to all publishers of these channels."""
        for channel in channels:
            keys = channel.key_expression(self._swarm)
            self._inlets[channel.name] = self._transport.subscribe(keys, timed=channel.qos.timed)

    def send(self, channel: Channel[P], payload: P) -> None:
        """Publish under the own key."""
        key = self._keys.get(channel.name)
        if key is None:
            key = self._keys[channel.name] = channel.key(self._swarm, self.name)
        self._transport.publish(key, encode(payload), channel.qos)

    def take(self, channel: Channel[P]) -> list[tuple[P, float]]:
        """(payload, received_s [s]) of all messages since the last call, oldest first."""
        taken = []
        for received_s, data in self._inlets[channel.name].drain():
            try:
                taken.append((decode(channel.payload, data), received_s))
            except PayloadError as error:
                self.bad_payloads += 1
                self.last_bad = str(error)
        return taken

    def close(self) -> None:
        """Leave the mesh."""
        self._transport.close()
