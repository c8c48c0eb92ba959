"""Passes frames between a radio and the agents of the vehicles behind it, by MAVLink system id.

Nothing here waits, and no frame is changed: signatures stay whole. A frame of another system
reaches no agent; bytes that are no frame end here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.engine.radio.load import Flow, RadioLoad, VehicleLoad
from swarm_ctl.mavlink.addressed import Urgency, boot_ms, urgency, what
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.link import MAX_CHUNKS, MAX_TRIED
from swarm_ctl.mavlink.wires import Wire

STALLED_S: Final = 0.5
"""A link that did not run for so long (stopped, a computer that sleeps) throws away what has come
meanwhile: it is not new, and would look new."""


@dataclass(frozen=True, slots=True)
class RadioRoute:
    """An agent at the link."""

    agent: FleetAgent
    wire: Wire
    setpoint_hz: float


class _Ear:
    """The frames of one wire, a bounded number at a time."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._framers = [Framer() for _ in range(wire.sources)]
        self.trouble = ""

    @property
    def bad(self) -> int:
        return sum(framer.bad for framer in self._framers)

    def frames(self, now: float) -> Iterator[MavlinkFrame]:
        tried = 0
        for _ in range(MAX_CHUNKS):
            try:
                chunk = self._wire.read(now)
            except OSError as error:
                self.trouble = str(error)
                return
            if chunk is None or tried > MAX_TRIED:
                return
            self.trouble = ""
            framer = self._framers[self._wire.source]
            tried -= framer.tried
            yield from framer.feed(chunk)
            tried += framer.tried


class _Port:
    """An agent, its vehicle, and what has passed between them."""

    def __init__(self, route: RadioRoute) -> None:
        self.agent, self.wire = route.agent, route.wire
        self.ear = _Ear(route.wire)
        self.lane = Lane(route.setpoint_hz)
        self.lateness = Lateness()
        self.up, self.down, self.setpoints = Flow(), Flow(), Flow()
        self.late = self.unsent = 0
        self.heard_s: float | None = None

    def load(self, now: float) -> VehicleLoad:
        up, down = self.up.per_s(now), self.down.per_s(now)
        return VehicleLoad(
            agent=self.agent.id,
            sysid=self.agent.sysid,
            up_frames_per_s=up[0],
            down_frames_per_s=down[0],
            setpoints_per_s=self.setpoints.per_s(now)[0],
            bytes_per_s=up[1] + down[1],
            thinned=self.lane.thinned,
            dropped=self.lane.dropped + self.unsent,
            late=self.late,
            age_s=None if self.heard_s is None else now - self.heard_s,
        )


class Switch:
    """Joins a radio and its agents; `turn` is to be called every few milliseconds."""

    def __init__(
        self, radio: Wire, routes: Sequence[RadioRoute], name: str, bytes_per_s: int
    ) -> None:
        self._name, self._bytes_per_s = name, bytes_per_s
        self._ports = {route.agent.id: _Port(route) for route in routes}
        self._by_system = {port.agent.sysid: port for port in self._ports.values()}
        self._by_agent_system = {port.agent.agent_sysid: port for port in self._ports.values()}
        lanes = {agent: port.lane for agent, port in self._ports.items()}
        self._uplink = Uplink(lanes, bytes_per_s)
        self._down = Flow()
        self._foreign = 0
        self._turned_s: float | None = None
        self._radio, self._ear = radio, _Ear(radio)

    @property
    def trouble(self) -> str:
        """Why the radio can't be used, or ''; it opens again by itself."""
        return self._radio.trouble or self._ear.trouble

    def turn(self, now: float) -> None:
        """Take in what has come, and send what may go now."""
        stalled = self._turned_s is not None and now - self._turned_s > STALLED_S
        self._turned_s = now
        for frame in self._ear.frames(now):
            self._come_down(frame, now, stalled=stalled)
        for port in self._ports.values():
            for frame in port.ear.frames(now):
                self._go_up(port, frame, now, stalled=stalled)
        for agent, frame in self._uplink.take(self._down.per_s(now)[1], now):
            self._send(self._ports[agent], frame, now)

    def _come_down(self, frame: MavlinkFrame, now: float, *, stalled: bool) -> None:
        """To the vehicle's agent; another sender with an agent's system id to that agent, which
        refuses to arm beside it."""
        port = self._by_system.get(frame.system)
        self._down.add(len(frame.raw), now)
        if port is None:
            self._foreign += 1
            port = self._by_agent_system.get(frame.system)
        else:
            self._radio.confirm(frame.system)
            port.down.add(len(frame.raw), now)
            port.heard_s = now
        if port is None or stalled:
            return
        if frame.system == port.agent.sysid and port.lateness.late(frame, now):
            port.late += 1
            return
        _written(port.wire, frame, now)

    def _go_up(self, port: _Port, frame: MavlinkFrame, now: float, *, stalled: bool) -> None:
        """An agent speaks for no vehicle. Of what waited while the link stood, commands alone are
        still wanted."""
        if frame.system in self._by_system:
            self._foreign += 1
            return
        if frame.system == port.agent.agent_sysid:
            port.wire.confirm()
        if not stalled or urgency(frame) is not Urgency.SETPOINT:
            port.lane.put(frame, now)

    def _send(self, port: _Port, frame: MavlinkFrame, now: float) -> None:
        if not _written(self._radio, frame, now, port.agent.sysid):
            port.unsent += 1
            return
        port.up.add(len(frame.raw), now)
        if urgency(frame) is Urgency.SETPOINT:
            port.setpoints.add(len(frame.raw), now)

    def load(self, now: float) -> RadioLoad:
        """What passes now."""
        vehicles = tuple(port.load(now) for port in self._ports.values())
        used = self._down.per_s(now)[1] + sum(p.up.per_s(now)[1] for p in self._ports.values())
        bad = self._ear.bad + sum(port.ear.bad for port in self._ports.values())
        return RadioLoad(
            radio=self._name,
            bytes_per_s=self._bytes_per_s,
            used_bytes_per_s=used,
            foreign=self._foreign,
            bad=bad,
            trouble=self.trouble,
            vehicles=vehicles,
        )


def _written(wire: Wire, frame: MavlinkFrame, now: float, system: int = 0) -> bool:
    """Whether the wire took the frame: a full or broken one loses it, and the rest goes on."""
    try:
        wire.write(frame.raw, now, system)
    except OSError:
        return False
    return True


LATE_S: Final = 0.3
"""Later than the fastest position: with the next one's 0.2 s that is `OWN_FIX_S`."""
_DRIFT: Final = 2e-4
"""Clocks of vehicles differ by at most so much a second."""
_BOOTED_S: Final = 1.0
"""A clock that goes back by more has begun anew; frames that overtake each other differ by less."""


class Lateness:
    """Notices positions of one vehicle that have waited on their way down, by the vehicle's clock.

    A radio that is asked for more than it carries stores frames and delivers them late. An agent
    takes a position for as old as it is since it came, so one that waited must not reach it: then
    the agent hears none, and does as always.
    """

    def __init__(self) -> None:
        self.late_s = 0.0
        """How much later than the fastest one the newest position came [s]."""
        self._boot_s = -math.inf
        self._least_s = math.inf
        self._now = 0.0

    def late(self, frame: MavlinkFrame, now: float) -> bool:
        """Whether the frame is a position that came too late. The vehicle's clock begins anew when
        it boots."""
        at_ms = boot_ms(frame)
        if at_ms is None:
            return False
        boot_s = at_ms * 1e-3
        if boot_s < self._boot_s - _BOOTED_S:
            self._least_s = math.inf
        self._boot_s = boot_s
        drifted = self._least_s + (now - self._now) * _DRIFT
        self._least_s, self._now = min(drifted, now - boot_s), now
        self.late_s = now - boot_s - self._least_s
        return self.late_s > LATE_S


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
    """Shares a radio's bytes between the lanes of its agents. Pure; times are the caller's clock
    [s].

    Of a setpoint, a heartbeat or a repeated request only the newest waits. Setpoints never wait
    long enough to move a vehicle whose agent has stopped, and none is sent twice.

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
