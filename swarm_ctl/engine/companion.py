"""A process beside an agent, which shows what the agent says and hears: to ROS 2.

It is no member of the mesh: a second one on each drone's computer would take every state over the
radio again. The agent gives it a datagram a tick and never waits: one that is slow misses ticks,
one that hangs or dies is told once. It ends when the agent does.
"""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from pydantic import TypeAdapter

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.signals import deaf_children

_LARGEST: Final = 1 << 20
"""Bytes of a tick; a socket's own limit is smaller."""
_LENGTHS: Final = struct.Struct("<HI")
"""Of a key and of its message, which follow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CompanionConfig:
    """All that such a process is told, on its stdin."""

    plan: Plan
    agent: int
    epoch_s: float
    speedup: float
    stepped: bool
    """The agent flies in lockstep."""
    attach: tuple[str, ...]
    """Extensions, each `NAME[=ARGUMENT]`."""


CONFIG_JSON: Final = TypeAdapter(CompanionConfig)


class Companion:
    """The agent's side: starts the process at once, and gives it the messages."""

    def __init__(self, config: CompanionConfig) -> None:
        self._waiting: list[tuple[str, bytes]] = []
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        module, given = "swarm_ctl.engine.station.companion_process", theirs.fileno()
        # a file, not a pipe: the agent does not wait until it is read
        with theirs, tempfile.TemporaryFile() as told, deaf_children():
            told.write(CONFIG_JSON.dump_json(config))
            told.seek(0)
            self.process: Final = subprocess.Popen(
                [sys.executable, "-m", module, str(given), str(os.getpid())],
                stdin=told,
                pass_fds=(given,),
            )

    def take(self, key: str, data: bytes) -> None:
        """Keep a message for the end of the tick."""
        self._waiting.append((key, data))

    def send(self) -> None:
        """Give it the tick's messages, if it has read those before. OSError where it has gone."""
        told, self._waiting = self._waiting, []
        parts = (
            part
            for key, data in told
            for part in (_LENGTHS.pack(len(key), len(data)), key.encode(), data)
        )
        with suppress(BlockingIOError):
            self._socket.send(b"".join(parts))


def received(messages: socket.socket) -> Iterator[tuple[str, bytes]]:
    """At the other end: what came since the last call, (key, bytes), oldest first."""
    with suppress(BlockingIOError):
        while True:
            tick, at = messages.recv(_LARGEST), 0
            while at < len(tick):
                key, size = _LENGTHS.unpack_from(tick, at)
                begin = at + _LENGTHS.size + key
                at = begin + size
                yield tick[begin - key : begin].decode(), tick[begin:at]
