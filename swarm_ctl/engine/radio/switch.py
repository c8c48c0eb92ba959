"""Passes frames between a radio and the agents of the vehicles behind it, by MAVLink system id.

Nothing here waits, and no frame is changed: signatures stay whole. A frame of another system
reaches no agent; bytes that are no frame end here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.engine.radio.lateness import Lateness
from swarm_ctl.engine.radio.load import Flow, RadioLoad, VehicleLoad
from swarm_ctl.engine.radio.uplink import Lane, Uplink
from swarm_ctl.mavlink.addressed import Urgency, urgency
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
