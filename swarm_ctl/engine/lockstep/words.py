"""What the keeper of mission time and its members tell each other: one JSON object a packet.

The sockets keep packets apart (SOCK_SEQPACKET in Linux's abstract name space): no framing, and a
process that dies is an end of file. `docs/understand/lockstep.md` has all of them. The simulator
speaks the same by itself (`swarm_sim.network.server`).
"""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final, NamedTuple

LONGEST: Final = 1 << 16
"""Bytes of a packet; the tick of 250 agents needs a fifth."""


class TickPhase(IntEnum):
    """When in a tick a member has its turn."""

    WORLD = 0
    """The simulator: the world up to the tick, from what the agents sent in the one before."""
    SWARM = 1
    """Agents and stations, side by side. They hear what was said in the tick before."""
    AFTER = 2
    """A test: alone, after all agents. It hears what they said in this tick."""


class TickWord(NamedTuple):
    """Run a tick. Tick 0 is the roll call: each member says an empty message on each of its
    channels, so that tick 1 shows whether all hear all."""

    tick: int
    heard: int
    """It hears what was said in this tick."""
    anew: bool
    """The member was not waited for before: it hears what has come, and waits for nothing."""
    agents: int
    """So many take part."""
    said: Mapping[str, int]
    """So many messages were said under each key of the mesh in the tick `heard`, in the order in
    which they are heard."""
    sent: Mapping[str, int]
    """So many datagrams came from (went to) each UDP port in this tick's other half."""


def packed(**word: Any) -> bytes:
    """As a packet."""
    return json.dumps(word, separators=(",", ":")).encode()


def read(data: bytes) -> dict[str, Any]:
    """Of a packet; ValueError where it holds no object."""
    word = json.loads(data)
    if not isinstance(word, dict):
        raise ValueError("no JSON object")
    return word


def packets() -> socket.socket:
    """A socket for these words."""
    return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
