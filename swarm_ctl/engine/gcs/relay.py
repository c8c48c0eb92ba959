"""Frames between vehicles and ground control software (GCS), by system id both ways.

What a GCS sends is limited in rate, for each vehicle, and refused where it speaks with the system
id of an agent or a vehicle, or would change what keeps a vehicle safe that an agent flies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from swarm_ctl.engine.gcs.gcs_socket import GcsClient, GcsSocket
from swarm_ctl.engine.gcs.throttle import Throttle
from swarm_ctl.engine.gcs.vehicle_port import VehiclePort
from swarm_ctl.mavlink.addressed import target_system
from swarm_ctl.mavlink.framer import MavlinkFrame
from swarm_ctl.mavlink.outgoing import said_beside

RATE_HZ: Final = 100.0
"""Frames a second from one GCS to one vehicle: twice a joystick's 50 Hz."""
SHARED_RATE_HZ: Final = 30.0
"""The same over an agent's only link, a telemetry radio perhaps, which carries the setpoints."""
BURST: Final = 50
_ANSWER_S: Final = 1.0
"""Between two answers to one GCS about what was refused."""
_SILENT_S: Final = 5.0
"""A vehicle that was not heard for so long has gone."""


class GcsRelay:
    """Carries what has come at each `step`. `notes` are lines for the operator."""

    def __init__(self, vehicles: Sequence[VehiclePort], sockets: Sequence[GcsSocket]) -> None:
        self.notes: list[str] = []
        self.from_vehicles = self.to_vehicles = self.refused = self.astray = 0
        self._ports = {port.config.sysid: port for port in vehicles}
        self._sockets = sockets
        self._owner = {port.config.sysid: f"vehicle {port.config.sysid}" for port in vehicles}
        self._owner |= {port.config.agent_sysid: f"agent {port.config.agent}" for port in vehicles}

    def step(self, now: float) -> None:
        """Both ways, once."""
        for port in self._ports.values():
            if frames := port.take(now):
                self.from_vehicles += len(frames)
                for each in self._sockets:
                    each.send(frames)
        for each in self._sockets:
            for peer, frame in each.take(now):
                self._route(each, peer, frame, now)
            for peer in each.peers:
                self._pass_on(peer, now)

    def flying(self, now: float) -> bool:
        """A vehicle is heard and armed."""
        return any(port.armed and now - port.heard_s < _SILENT_S for port in self._ports.values())

    def _route(self, socket: GcsSocket, peer: GcsClient, frame: MavlinkFrame, now: float) -> None:
        if not peer.introduced:
            peer.introduced = True
            self.notes.append(f"ground control software at {peer}, system {frame.system}")
        owner = self._owner.get(frame.system)
        if owner is not None:
            self.refused += 1
            self._warn(peer, f"speaks with the system id of {owner}, {frame.system}: refused")
            return
        target = target_system(frame)
        if target and target not in self._ports:
            self.astray += 1
            return
        for port in [self._ports[target]] if target else self._ports.values():
            if port.signs and not frame.signed:
                what = f"does not sign: vehicle {port.config.sysid} does not obey it"
                self._warn(peer, f"{what} (its key, or the RC, takes it over)")
            changes = port.endangers(frame)
            if not changes and port.passes(frame):
                self._throttle(peer, port).put(frame.raw)
                continue
            self.refused += 1
            if changes:
                self._deny(socket, peer, port, changes, now)

    def _deny(
        self, socket: GcsSocket, peer: GcsClient, port: VehiclePort, changes: str, now: float
    ) -> None:
        sysid = port.config.sysid
        self._warn(peer, f"sets {changes} of vehicle {sysid}, which its agent flies: refused")
        if now - peer.answered_s >= _ANSWER_S:
            peer.answered_s = now
            socket.answer(peer, said_beside(sysid, f"refused: {changes} while an agent flies"))

    def _throttle(self, peer: GcsClient, port: VehiclePort) -> Throttle:
        sysid = port.config.sysid
        if sysid not in peer.throttles:
            rate_hz = SHARED_RATE_HZ if port.config.shared else RATE_HZ
            peer.throttles[sysid] = Throttle(rate_hz, BURST)
        return peer.throttles[sysid]

    def _pass_on(self, peer: GcsClient, now: float) -> None:
        for sysid, throttle in peer.throttles.items():
            port = self._ports[sysid]
            for frame in throttle.take(now):
                self.to_vehicles += 1
                port.give(frame, now)
            if throttle.dropped:
                rate = SHARED_RATE_HZ if port.config.shared else RATE_HZ
                what = f"sends more than {rate:g} frames a second to vehicle {sysid}"
                self._warn(peer, f"{what}: the oldest are dropped")

    def _warn(self, peer: GcsClient, what: str) -> None:
        if what not in peer.told:
            peer.told.add(what)
            self.notes.append(f"ground control software at {peer} {what}")

    def account(self) -> str:
        """What was counted, for the log."""
        late = sum(t.dropped for s in self._sockets for p in s.peers for t in p.throttles.values())
        return (
            f"frames: {self.from_vehicles} from vehicles, {self.to_vehicles} to vehicles,"
            f" {self.refused} refused, {late} over the rate, {self.astray} to no vehicle of ours,"
            f" {sum(port.lost for port in self._ports.values())} not taken by a link;"
            f" datagrams to ground control software not sent:"
            f" {sum(each.unsent for each in self._sockets)}"
        )
