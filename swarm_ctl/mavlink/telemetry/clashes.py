"""Two that speak with one system id on one link: found by their frames, told in a sentence. Pure.

A single garbled or forged frame is no clash: each kind is seen several times within seconds.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import MavlinkFrame
from swarm_ctl.mavlink.outgoing import AUTOPILOT_COMPONENT

KEPT_S = 10.0
"""A clash that is not seen for so long is over."""
_APART_S = 0.5
"""Signs closer than this are one."""
_OWN_HEARTBEATS = 8
"""A radio may echo our frames, some seconds late."""
_WINDOW_S, _ODD_FRAMES = 1.0, 5
"""So many frames in a second that a single sender does not send."""
_RECENT, _NEAR = 32, 16
"""Frames; numbers of `seq`: reordering does not reach so far."""


@dataclass(slots=True)
class _Signs:
    needed: int
    count: int = 0
    last_s: float = -math.inf

    def note(self, now: float) -> None:
        if now - self.last_s >= _APART_S:
            self.count = self.count + 1 if now - self.last_s <= KEPT_S else 1
            self.last_s = now

    def stand(self, now: float) -> bool:
        return self.count >= self.needed and now - self.last_s <= KEPT_S


@dataclass(slots=True)
class _Sequence:
    """Tells two senders of one id apart by their counters: each frame has an 8-bit `seq`."""

    begun_s: float = -math.inf
    odd: int = 0
    now_at: int = 0
    other_at: int | None = None
    numbers: deque[int] = field(default_factory=lambda: deque(maxlen=_RECENT))
    recent: deque[bytes] = field(default_factory=lambda: deque(maxlen=_RECENT))
    """The newest frames, and their `seq`."""

    def two(self, frame: MavlinkFrame, now: float) -> bool:
        """Whether the second that ends with this frame had frames of two senders."""
        seq = frame.seq
        twice = seq in self.numbers and any(
            seq == each and frame.raw != raw
            for each, raw in zip(self.numbers, self.recent, strict=True)
        )
        self.numbers.append(seq)
        self.recent.append(frame.raw)
        self.odd += twice or self._switches(seq)
        if now - self.begun_s < _WINDOW_S:
            return False
        found = self.odd >= _ODD_FRAMES
        self.begun_s, self.odd = now, 0
        return found

    def _switches(self, seq: int) -> bool:
        """It goes on where frames stood before those of the other sender."""
        ahead = (seq - self.now_at) & 0xFF
        if ahead <= _NEAR or ahead >= 256 - _NEAR:
            self.now_at = seq
            return False
        back = self.other_at is not None and 0 < (seq - self.other_at) & 0xFF <= _NEAR
        self.now_at, self.other_at = seq, self.now_at
        return back


class Clashes:
    """What was seen on one link by an agent that speaks as `agent_sysid` to vehicle `sysid`."""

    def __init__(self, sysid: int, agent_sysid: int) -> None:
        self._sysid, self._agent_sysid = sysid, agent_sysid
        self._own: deque[bytes] = deque(maxlen=_OWN_HEARTBEATS)
        self._sequence = _Sequence()
        another = "give it another one, or the agent another agent_sysid in the fleet"
        # One sign is many frames, and an agent may be ready to arm within seconds.
        self._two = _Signs(1)
        self._kinds = _Signs(2)
        vehicles = (
            f"two vehicles speak with system id {sysid} on this link: give one of them another,"
            " or each a link of its own"
        )
        self._vehicle, self._sender = _Signs(2), _Signs(2)
        self._sentences = (
            (self._two, vehicles),
            (self._kinds, vehicles),
            (self._vehicle, f"a vehicle speaks with our system id {agent_sysid}: {another}"),
            (self._sender, f"another sender speaks with our system id {agent_sysid}: {another}"),
        )

    def sent(self, heartbeat: bytes) -> None:
        """Remember our own heartbeats, to know an echo."""
        self._own.append(heartbeat)

    def hear(self, frame: MavlinkFrame, now: float) -> None:
        """Any good frame of the link."""
        if frame.component == AUTOPILOT_COMPONENT and frame.system == self._sysid:
            if self._sequence.two(frame, now):
                self._two.note(now)
        elif frame.system != self._agent_sysid:
            return
        elif frame.component == AUTOPILOT_COMPONENT:
            self._vehicle.note(now)
        elif frame.message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT and frame.raw not in self._own:
            self._sender.note(now)

    def other_kind(self, now: float) -> None:
        """The vehicle's id was heard from another firmware or type of vehicle."""
        self._kinds.note(now)

    def found(self, now: float) -> str:
        """What clashes and what to do, or ''."""
        for signs, text in self._sentences:
            if signs.count and signs.stand(now):
                return text
        return ""
