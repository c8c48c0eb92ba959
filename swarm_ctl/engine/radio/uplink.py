"""What waits for a shared radio, and what goes next. Pure; times are the caller's clock [s].

Of a setpoint, a heartbeat or a repeated request only the newest waits. Setpoints never wait long
enough to move a vehicle whose agent has stopped, and none is sent twice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from swarm_ctl.mavlink.addressed import Urgency, urgency, what
from swarm_ctl.mavlink.framer import MavlinkFrame

SETPOINT_KEPT_S: Final = 0.25
"""An older setpoint is not sent; half of an ArduCopter's setpoint time-out."""
MOST_WAITING: Final = 32
"""Frames of one agent."""
_STARVED_S: Final = 1.0
"""A request that has waited so long takes its turn with setpoints: agents ask once a second."""
_COMMANDS_APART_S: Final = 0.1
"""Of one agent, that go before the setpoints of all; a termination is repeated each 0.2 s."""
_FILLED: Final = 0.9
"""Of the radio's bytes: a radio that is filled stores frames, and all of them come late."""
_LEAST_SHARE: Final = 1 / 3
"""Of them, for what goes up however much comes down: setpoints and commands must leave."""
_BURST_S: Final = 0.05
"""So much may be sent at once; it stays small, because the radio's own buffer is a queue where no
newer frame overtakes an older one."""


@dataclass(slots=True)
class _Waiting:
    frame: MavlinkFrame
    urgency: Urgency
    since_s: float


class Lane:
    """The frames of one agent that wait. At most `setpoint_hz` setpoints leave in a second.

    Signed frames leave in the order of their stamps, because a vehicle takes an older stamp for a
    replay. There what is urgent takes what waits before it along.
    """

    def __init__(self, setpoint_hz: float) -> None:
        self.thinned = 0
        """Setpoints, heartbeats and repeated requests that a newer one replaced, or that grew
        old."""
        self.dropped = 0
        """Other frames for which there was no room."""
        self.served_s = -math.inf
        self._interval_s = 1.0 / setpoint_hz
        self._setpoint_due_s = self._command_due_s = -math.inf
        self._waiting: dict[tuple[int, int, bytes], _Waiting] = {}

    def put(self, frame: MavlinkFrame, now: float) -> None:
        """Let the frame wait, in the place of the one that it replaces."""
        key, entry = what(frame), _Waiting(frame, urgency(frame), now)
        if old := self._waiting.get(key):
            self.thinned += 1
            if frame.signed:
                del self._waiting[key]
            if entry.urgency is Urgency.REST:
                entry.since_s = old.since_s
        elif len(self._waiting) >= MOST_WAITING and not self._make_room(entry.urgency):
            return
        self._waiting[key] = entry

    def _make_room(self, for_whom: Urgency) -> bool:
        self.dropped += 1
        rest = (key for key, each in self._waiting.items() if each.urgency is Urgency.REST)
        victim = None if for_whom is Urgency.REST else next(rest, None)
        if victim is not None:
            del self._waiting[victim]
        return victim is not None

    def rank(self, now: float) -> int | None:
        """How urgent the most urgent frame is that may leave now; None: none may."""
        self._forget_old_setpoints(now)
        return min((self._rank(each, now) for _, each in self._ready(now)), default=None)

    def take(self, now: float) -> MavlinkFrame:
        """The next frame; one may leave."""
        ready = list(self._ready(now))
        if ready[0][1].frame.signed:
            key = ready[0][0]
            self._drop_setpoints_before(key)
        else:
            key = min(ready, key=lambda each: self._rank(each[1], now))[0]
        entry = self._waiting.pop(key)
        if entry.urgency is Urgency.SETPOINT:
            late = now - self._setpoint_due_s
            kept = self._setpoint_due_s if late < self._interval_s else now
            self._setpoint_due_s = kept + self._interval_s
        if entry.urgency is Urgency.COMMAND:
            self._command_due_s = now + _COMMANDS_APART_S
        self.served_s = now
        return entry.frame

    def _rank(self, each: _Waiting, now: float) -> Urgency:
        """Starved requests, and commands in a flood, take their turn with setpoints."""
        if each.urgency is Urgency.COMMAND and now < self._command_due_s:
            return Urgency.SETPOINT
        starved = each.urgency is Urgency.REST and now - each.since_s > _STARVED_S
        return Urgency.SETPOINT if starved else each.urgency

    def _ready(self, now: float) -> Iterator[tuple[tuple[int, int, bytes], _Waiting]]:
        for key, each in self._waiting.items():
            if each.urgency is not Urgency.SETPOINT or now >= self._setpoint_due_s:
                yield key, each

    def _forget_old_setpoints(self, now: float) -> None:
        for key, each in list(self._waiting.items()):
            if each.urgency is Urgency.SETPOINT and now - each.since_s > SETPOINT_KEPT_S:
                del self._waiting[key]
                self.thinned += 1

    def _drop_setpoints_before(self, key: tuple[int, int, bytes]) -> None:
        """Not due, and older than the frame that leaves: the next setpoint has a newer stamp."""
        for other in list(self._waiting):
            if other == key:
                return
            del self._waiting[other]
            self.thinned += 1


class Uplink:
    """Shares a radio's bytes between the lanes of its agents.

    `bytes_per_s` is what the radio carries in both directions together; what comes down is not
    there for what goes up, but for `_LEAST_SHARE`.
    """

    def __init__(self, lanes: Mapping[int, Lane], bytes_per_s: float) -> None:
        self._lanes = lanes
        self._bytes_per_s = bytes_per_s
        self._room = 0.0
        self._now: float | None = None

    def take(self, down_bytes_per_s: float, now: float) -> Iterator[tuple[int, MavlinkFrame]]:
        """The agents and frames to send now, the most urgent ones first, and among equals those of
        the agent that has waited longest."""
        free = self._bytes_per_s * _FILLED - down_bytes_per_s
        rate = max(self._bytes_per_s * _LEAST_SHARE, free)
        passed_s = 0.0 if self._now is None else now - self._now
        self._now = now
        self._room = min(self._room + rate * passed_s, rate * _BURST_S)
        while self._room > 0:
            ranks = {agent: lane.rank(now) for agent, lane in self._lanes.items()}
            ready = [(rank, agent) for agent, rank in ranks.items() if rank is not None]
            if not ready:
                return
            agent = min(ready, key=lambda each: (each[0], self._lanes[each[1]].served_s))[1]
            frame = self._lanes[agent].take(now)
            self._room -= len(frame.raw)
            yield agent, frame
