"""Payloads as bytes. The first byte is the version; an unknown version is refused.

`AgentState`, sent every tick, has a fixed little-endian layout (`_STATE`), and so has `ClockNews`
(`_CLOCK`, then an `_ECHO` for each peer). All other payloads are JSON after the version byte,
checked field by field by pydantic. The version is a byte that JSON takes for a blank (9, 10, 13 or
32), so that each of them is JSON as a whole to any tool.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache
from operator import attrgetter
from typing import Any, Final, TypeVar

from pydantic import TypeAdapter, ValidationError

from swarm_ctl.core.model.messages import (
    LEAVING,
    Ack,
    AgentState,
    AgentStatus,
    Answers,
    ClockEcho,
    ClockNews,
    Command,
    CommandKind,
    Event,
    ExchangeState,
    Glimpse,
    LawNews,
    Phase,
    SigmaReport,
    StationBeacon,
    TargetWord,
)
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.errors import PayloadError

VERSION: Final = 9
P = TypeVar("P")
_LONGEST_WORD: Final = 100
"""Of a command: agents give its id back, and keep it."""

_FAR: Final = 1e6
"""Of a target: metres, metres a second, seconds."""

_STATE: Final = struct.Struct("<BBHIdQHB3d3f2d2f2d3f2fBBIII8h")
"""version, flags, agent, seq, time_s, plan_hash, step, phase, position_ned_m, velocity_ned_mps,
stop_point_m, setpoint_mps, frame (point_m, angle_rad, scale, rate), response_s, doubt_s, frame.leg,
stage, override, gains_tag, next_gains_tag, exchange. Flags: bit 0 done, bit 1 airborne, bit 2 frame
(else its fields are 0), bits 3, 4 and 7 left (its place in `LEAVING`, from 1; 0: none), bit 5 down,
bit 6 a target leads the frame (else `_LED` is left out)."""
_HEIGHT: Final = struct.Struct("<f")
"""goal_height_m, behind a state of a mission whose slots have heights."""
_LED: Final = struct.Struct("<2f")
"""frame.velocity_mps, behind the rest."""
STATE_BYTES: Final = _STATE.size + _LED.size + _HEIGHT.size
"""Of the longest state."""
_SIZES: Final = tuple(
    _STATE.size + led + high for led in (0, _LED.size) for high in (0, _HEIGHT.size)
)
_STATE_PEEK: Final = struct.Struct("<2xH4xd11x2d")
"""agent, time_s, north and east of the same."""
_DONE, _AIRBORNE, _FRAME, _DOWN, _IS_LED = 1, 2, 4, 32, 64
_PHASES: Final[dict[int, Phase]] = {phase.value: phase for phase in Phase}
_LEFT: Final = (None, *LEAVING)
_LEFT_BIT, _LEFT_HIGH = 3, 7
_CLOCK: Final = struct.Struct("<BHdB")
"""version, agent, time_s, the answers that are wanted"""
_ECHO: Final = struct.Struct("<Hdd")
"""agent, told_s, held_s"""
_NO_FRAME: Final = Frame((0.0, 0.0), scale=0.0)
_UNSAID: Final = (b',"own":[]', b',"closings":[]')
"""`Gains.own` of the paper's law, and `AgentStatus.closings` of a shape that is whole: a narrow
radio need not hear them. In a text they would have other quotes."""
_exchange = lru_cache(1024)(ExchangeState)
"""Most states repeat the one before: equal ones are one object, which compares fast."""
_exchange_fields = attrgetter(*(field.name for field in fields(ExchangeState)))


def is_json(kind: type[object]) -> bool:
    """Whether the bytes of this type of payload are JSON, version byte included."""
    return kind in _ADAPTERS


def encode(payload: object) -> bytes:
    """The bytes of a payload of the table in `mesh/keys.py`."""
    if isinstance(payload, AgentState):
        return _encode_state(payload)
    if isinstance(payload, ClockNews):
        return _encode_clock(payload)
    told = _ADAPTERS[type(payload)].dump_json(payload)
    for nothing in _UNSAID:
        told = told.replace(nothing, b"")
    return bytes([VERSION]) + told


def decode(kind: type[P], data: bytes) -> P:
    """The payload of type `kind` in `data`; PayloadError when the bytes hold none."""
    if not data or data[0] != VERSION:
        found = f"version {data[0]}" if data else "no bytes"
        raise PayloadError(f"{kind.__name__}: {found}; known: version {VERSION}")
    try:
        payload: P = _READERS[kind](data)
        return payload
    except (ValidationError, struct.error, ValueError) as error:
        raise PayloadError(f"{kind.__name__}: {_first_line(error)}") from None


def _decode_command(data: bytes) -> Command:
    command: Command = _ADAPTERS[Command].validate_json(data[1:])
    if max(len(command.id), len(command.kind)) > _LONGEST_WORD:
        raise ValueError(f"id or kind of more than {_LONGEST_WORD} characters")
    return command


def _decode_target(data: bytes) -> TargetWord:
    word: TargetWord = _ADAPTERS[TargetWord].validate_json(data[1:])
    rest = (word.altitude_m or 0.0, word.accuracy_m, *(word.velocity_ned_mps or ()))
    on_earth = abs(word.latitude_deg) <= 89.0 and abs(word.longitude_deg) <= 180.0
    if not on_earth or not all(abs(number) <= _FAR for number in rest):
        raise ValueError(f"is nowhere on earth, or of no size; allowed: up to {_FAR:g}")
    if not 0.0 <= word.age_s <= _FAR:
        raise ValueError(f"is {word.age_s:g} s old; allowed: 0 to {_FAR:g}")
    return word


# Built on import (30 ms), in the agents' forkserver: no control loop stalls at its first status.
_ADAPTERS: Final[dict[type[Any], TypeAdapter[Any]]] = {
    kind: TypeAdapter(kind)
    for kind in (AgentStatus, LawNews, TargetWord, SigmaReport, Event, Ack, Command, StationBeacon)
}


def _encode_state(s: AgentState) -> bytes:
    flags = _DONE * s.done | _AIRBORNE * s.airborne | _FRAME * (s.frame is not None)
    left = _LEFT.index(s.left)
    flags |= (left & 3) << _LEFT_BIT | left >> 2 << _LEFT_HIGH | _DOWN * s.down
    frame = s.frame or _NO_FRAME
    flags |= _IS_LED * (frame.velocity_mps != (0.0, 0.0))
    head = (VERSION, flags, s.agent, s.seq, s.time_s, s.plan_hash, s.step, s.phase)
    motion = (*s.position_ned_m, *s.velocity_ned_mps, *s.stop_point_m, *s.setpoint_mps)
    shared = (*frame.point_m, frame.angle_rad, frame.scale, frame.rate)
    response = (s.response_s, s.doubt_s, min(frame.leg, 255))
    progress = (s.stage, s.override, s.gains_tag, s.next_gains_tag)
    rest = b"" if s.goal_height_m is None else _HEIGHT.pack(s.goal_height_m)
    if flags & _IS_LED:
        rest = _LED.pack(*frame.velocity_mps) + rest
    exchange = _exchange_fields(s.exchange)
    return _STATE.pack(*head, *motion, *shared, *response, *progress, *exchange) + rest


def _decode_state(data: bytes) -> AgentState:
    values, rest = _STATE.unpack_from(data), data[_STATE.size :]
    _, flags, agent, seq, time_s, plan_hash, step, phase = values[:8]
    led_mps, goal_m = (0.0, 0.0), None
    if flags & _IS_LED:
        led_mps, rest = _LED.unpack_from(rest), rest[_LED.size :]
    if rest:
        (goal_m,) = _HEIGHT.unpack(rest)
    # One sum for all floats: it is not finite if one of them is not.
    if not math.isfinite(sum(values[8:25], time_s) + led_mps[0] + led_mps[1] + (goal_m or 0.0)):
        raise ValueError("a number is not finite")
    angle_rad, scale, rate, response_s, doubt_s, leg = values[20:26]
    frame = None
    if flags & _FRAME:
        frame = Frame(values[18:20], angle_rad, scale, leg, rate, led_mps)
    stage, command, law, next_law = values[26:30]
    return AgentState(
        agent,
        seq,
        time_s,
        plan_hash,
        _PHASES.get(phase) or Phase(phase),
        step,
        flags & _DONE != 0,
        flags & _AIRBORNE != 0,
        values[8:11],  # position (north, east, down)
        values[11:14],  # velocity
        values[14:16],  # stop point (north, east)
        values[16:18],  # setpoint
        frame,
        stage,
        command,
        law,
        next_law,
        _exchange(*values[30:]),
        response_s,
        doubt_s,
        _left(flags),
        flags & _DOWN != 0,
        goal_m,
    )


def _left(flags: int) -> CommandKind | None:
    left = flags >> _LEFT_BIT & 3 | flags >> _LEFT_HIGH << 2
    if left >= len(_LEFT):
        raise ValueError(f"has left in way {left}; allowed: 0 to {len(_LEFT) - 1}")
    return _LEFT[left]


def glimpse(kind: type[object], data: bytes) -> Glimpse | None:
    """A state or a clock word, unchecked, with a tenth of the work of `decode`; None: neither."""
    if kind is AgentState and len(data) in _SIZES:
        agent, time_s, north, east = _STATE_PEEK.unpack_from(data)
        return Glimpse(agent, time_s, (north, east))
    if kind is ClockNews and len(data) >= _CLOCK.size:
        _, agent, time_s, _ = _CLOCK.unpack_from(data)
        return Glimpse(agent, time_s)
    return None


def _encode_clock(news: ClockNews) -> bytes:
    head = _CLOCK.pack(VERSION, news.agent, news.time_s, news.wants)
    return head + b"".join(_ECHO.pack(echo.agent, echo.told_s, echo.held_s) for echo in news.echoes)


def _decode_clock(data: bytes) -> ClockNews:
    _, agent, time_s, wants = _CLOCK.unpack_from(data)
    echoes = tuple(ClockEcho(*echo) for echo in _ECHO.iter_unpack(memoryview(data)[_CLOCK.size :]))
    times = (time_s, *(e.told_s for e in echoes), *(e.held_s for e in echoes))
    if not all(map(math.isfinite, times)):
        raise ValueError("a number is not finite")
    return ClockNews(agent, time_s, Answers(wants), echoes)


def _decode_json(kind: type[object]) -> Callable[[bytes], object]:
    validate = _ADAPTERS[kind].validate_json
    return lambda data: validate(data[1:])


_READERS: Final[dict[type[Any], Callable[[bytes], Any]]] = {
    kind: _decode_json(kind) for kind in _ADAPTERS
} | {
    Command: _decode_command,
    TargetWord: _decode_target,
    # What many hear, and nothing in it changes: where they share a process, equal bytes are one
    # object.
    AgentState: lru_cache(128)(_decode_state),
    ClockNews: lru_cache(128)(_decode_clock),
    StationBeacon: lru_cache(8)(_decode_json(StationBeacon)),
    AgentStatus: lru_cache(32)(_decode_json(AgentStatus)),
}


def _first_line(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error).splitlines()[0]
