"""Payloads as bytes. The first byte is the version; an unknown one is refused, never guessed.

`AgentState` is sent every tick and has a fixed little-endian layout (`_STATE`), and so has
`ClockNews` (`_CLOCK`, then one `_ECHO` each); everything else is JSON after the version byte,
checked field by field by pydantic.
"""

from __future__ import annotations

import math
import struct
from functools import lru_cache
from typing import Any, Final, TypeVar

from pydantic import TypeAdapter, ValidationError

from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    ClockEcho,
    ClockNews,
    Command,
    Event,
    ExchangeState,
    Frame,
    Phase,
    SigmaReport,
    StationBeacon,
)
from swarm_ctl.errors import PayloadError

VERSION: Final = 3
P = TypeVar("P")

_STATE: Final = struct.Struct("<BBHIdQHB3d3f2d2f2d3fBBIII8h")
"""version, flags, agent, seq, time_s, plan_hash, step, phase, position_ned_m, velocity_ned_mps,
stop_point_m, commanded_mps, frame (point_m, angle_rad, scale, rate, leg), stage, command, law,
next_law, deal. Flags: bit 0 done, bit 1 airborne, bit 2 frame (without it the frame's fields are
0)."""
_DONE, _AIRBORNE, _FRAME = 1, 2, 4
_CLOCK: Final = struct.Struct("<BHd?")
"""version, agent, time_s, asks"""
_ECHO: Final = struct.Struct("<Hdd")
"""agent, told_s, held_s"""
_NO_FRAME: Final = Frame((0.0, 0.0), scale=0.0)
_deal = lru_cache(1024)(ExchangeState)
"""Most states repeat the one before, and whoever compares them sees the same object."""


def encode(payload: object) -> bytes:
    """Bytes of any payload of the table in `mesh/keys.py`."""
    if isinstance(payload, AgentState):
        return _encode_state(payload)
    if isinstance(payload, ClockNews):
        return _encode_clock(payload)
    return bytes([VERSION]) + _adapter(type(payload)).dump_json(payload)


def decode(kind: type[P], data: bytes) -> P:
    """The payload of type `kind` in `data`; PayloadError when the bytes are not one."""
    if not data or data[0] != VERSION:
        found = f"version {data[0]}" if data else "no bytes"
        raise PayloadError(f"{kind.__name__}: {found}; known: version {VERSION}")
    try:
        if kind is AgentState:
            return _decode_state(data)  # type: ignore[return-value]
        if kind is ClockNews:
            return _decode_clock(data)  # type: ignore[return-value]
        return _adapter(kind).validate_json(memoryview(data)[1:].tobytes())
    except (ValidationError, struct.error, ValueError) as error:
        raise PayloadError(f"{kind.__name__}: {_first_line(error)}") from None


def _adapter(kind: type[P]) -> TypeAdapter[P]:
    return _ADAPTERS[kind]


# Built on import (30 ms): the agents' forkserver does it once for all, and no control loop stalls
# at its first status.
_ADAPTERS: Final[dict[type[Any], TypeAdapter[Any]]] = {
    kind: TypeAdapter(kind)
    for kind in (AgentStatus, SigmaReport, Event, Ack, Command, StationBeacon)
}


def _encode_state(s: AgentState) -> bytes:
    flags = _DONE * s.done | _AIRBORNE * s.airborne | _FRAME * (s.frame is not None)
    frame, deal = s.frame or _NO_FRAME, s.deal
    return _STATE.pack(
        VERSION,
        flags,
        s.agent,
        s.seq,
        s.time_s,
        s.plan_hash,
        s.step,
        s.phase,
        *s.position_ned_m,
        *s.velocity_ned_mps,
        *s.stop_point_m,
        *s.commanded_mps,
        *frame.point_m,
        frame.angle_rad,
        frame.scale,
        frame.rate,
        min(frame.leg, 255),
        s.stage,
        s.command,
        s.law,
        s.next_law,
        deal.role,
        deal.version,
        deal.lock,
        deal.offer_to,
        deal.offer_version,
        deal.answer_to,
        deal.answer_version,
        deal.answer_role,
    )


def _decode_state(data: bytes) -> AgentState:
    _, flags, agent, seq, time_s, plan_hash, step, phase, *rest = _STATE.unpack(data)
    numbers, (leg, stage, command, law, next_law), deal = rest[:-13], rest[-13:-8], rest[-8:]
    if not math.isfinite(sum(numbers, time_s)):  # one that is not finite makes the sum so
        raise ValueError("a number is not finite")
    n, e, d, vn, ve, vd, stop_n, stop_e, cmd_n, cmd_e, *framed = numbers
    north, east, angle, scale, rate = framed
    return AgentState(
        agent,
        seq,
        time_s,
        plan_hash,
        Phase(phase),
        step,
        bool(flags & _DONE),
        bool(flags & _AIRBORNE),
        (n, e, d),
        (vn, ve, vd),
        (stop_n, stop_e),
        (cmd_n, cmd_e),
        Frame((north, east), angle, scale, leg, rate) if flags & _FRAME else None,
        stage,
        command,
        law,
        next_law,
        _deal(*deal),
    )


def _encode_clock(news: ClockNews) -> bytes:
    head = _CLOCK.pack(VERSION, news.agent, news.time_s, news.asks)
    return head + b"".join(_ECHO.pack(echo.agent, echo.told_s, echo.held_s) for echo in news.echoes)


def _decode_clock(data: bytes) -> ClockNews:
    _, agent, time_s, asks = _CLOCK.unpack_from(data)
    echoes = tuple(ClockEcho(*echo) for echo in _ECHO.iter_unpack(memoryview(data)[_CLOCK.size :]))
    if not all(
        map(math.isfinite, (time_s, *(e.told_s for e in echoes), *(e.held_s for e in echoes)))
    ):
        raise ValueError("a number is not finite")
    return ClockNews(agent, time_s, asks, echoes)


def _first_line(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error).splitlines()[0]
