"""What the keeper of mission time and its members tell each other, one word a packet.

The sockets keep packets apart (SOCK_SEQPACKET in Linux's abstract name space): no framing, and a
process that dies is an end of file. The simulator speaks the same words by itself
(`swarm_sim.network.lockstep`).
"""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, Final, NamedTuple

LONGEST: Final = 1 << 16
"""Bytes of a packet; a hundred agents need a tenth."""


class Word(IntEnum):
    """The first byte of a packet."""

    JOIN = 1
    """A member's name, phase and the UDP port that it speaks to its vehicle from (JSON)."""
    WELCOME = 2
    """Its number, the length of a tick, and the other members (JSON)."""
    READY = 3
    """It hears every member that it has to hear."""
    TICK = 4
    """The keeper: run this tick (`TickWord`)."""
    DONE = 5
    """A member: it has run this tick (`Done`)."""
    WAIT = 6
    """The keeper lives, and waits for others."""
    NOTE = 7
    """A member: a line for the operator."""
    DROP = 8
    """A test: do not wait for the member with this name."""
    TAKE = 9
    """A test: the member with this name takes part again."""


class TickPhase(IntEnum):
    """When in a tick a member has its turn."""

    WORLD = 0
    """The simulator: the world up to the tick, from what the agents sent in the one before."""
    SWARM = 1
    """Agents and stations, side by side. They hear what was published in the tick before."""
    AFTER = 2
    """A test: alone, after all agents. It hears what they published in this tick."""


class TickWord(NamedTuple):
    """Run a tick. Messages of the ticks up to `heard` belong to it; those of the last of these are
    listed, and must be waited for."""

    number: int
    heard: int
    anew: bool
    """The member was not waited for before: what it has counted is void."""
    agents: int
    """So many take part."""
    published: Sequence[tuple[int, int, int]]
    """(member, channel, messages) of the tick `heard`."""
    datagrams: Mapping[int, int]
    """So many came from (went to) each UDP port in this tick's other half."""


class Done(NamedTuple):
    """A tick was run: so many messages by channel, so many datagrams by UDP port."""

    number: int
    last: bool
    """The member leaves."""
    published: Mapping[int, int]
    datagrams: Mapping[int, int]


_TICK: Final = struct.Struct("<BII?HH")
_DONE: Final = struct.Struct("<BI?H")
_PUBLISHED: Final = struct.Struct("<HBH")
_COUNT: Final = struct.Struct("<BH")
_PORT: Final = struct.Struct("<HI")


def pack_tick(tick: TickWord) -> bytes:
    """As a packet."""
    listed = tick.published
    head = _TICK.pack(Word.TICK, tick.number, tick.heard, tick.anew, tick.agents, len(listed))
    return head + b"".join([_PUBLISHED.pack(*p) for p in listed]) + _ports(tick.datagrams)


def read_tick(data: bytes) -> TickWord:
    """Of a packet."""
    _, number, heard, anew, agents, count = _TICK.unpack_from(data)
    end = _TICK.size + count * _PUBLISHED.size
    published = list(_PUBLISHED.iter_unpack(data[_TICK.size : end]))
    return TickWord(number, heard, anew, agents, published, dict(_PORT.iter_unpack(data[end:])))


def pack_done(done: Done) -> bytes:
    """As a packet."""
    head = _DONE.pack(Word.DONE, done.number, done.last, len(done.published))
    counts = b"".join([_COUNT.pack(*item) for item in done.published.items()])
    return head + counts + _ports(done.datagrams)


def read_done(data: bytes) -> Done:
    """Of a packet."""
    _, number, last, count = _DONE.unpack_from(data)
    end = _DONE.size + count * _COUNT.size
    published = dict(_COUNT.iter_unpack(data[_DONE.size : end]))
    return Done(number, last, published, dict(_PORT.iter_unpack(data[end:])))


def _ports(datagrams: Mapping[int, int]) -> bytes:
    return b"".join([_PORT.pack(*item) for item in datagrams.items()])


def pack_json(word: Word, **fields: Any) -> bytes:
    """JOIN or WELCOME."""
    return bytes([word]) + json.dumps(fields).encode()


def read_json(data: bytes) -> dict[str, Any]:
    """The fields of JOIN or WELCOME."""
    fields: dict[str, Any] = json.loads(data[1:])
    return fields


def packets() -> socket.socket:
    """A socket for these words."""
    return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
