"""`python -m swarm_ctl.engine.gcs.gcs_process RUN`: serves ground control software (GCS).

A process of its own, so that a GCS that floods, hangs or dies takes no time from an agent. At its
lifeline's end it goes on until no vehicle is armed any more, so that a pilot sees them come down.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.forked import serve
from swarm_ctl.engine.gcs.config import RelayVehicle
from swarm_ctl.engine.gcs.gcs_socket import GcsClient, GcsSocket, Throttle
from swarm_ctl.engine.launch_file import read_launch
from swarm_ctl.engine.lifeline import READY, PipeLifeline
from swarm_ctl.errors import StartError
from swarm_ctl.mavlink.addressed import (
    asks_for_streams,
    sets_parameter,
    target_system,
    told_mode,
    writes_file,
)
from swarm_ctl.mavlink.autopilots import GUARDED, flown_by_agent
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.outgoing import said_beside
from swarm_ctl.mavlink.wires import Wire, open_wire

_CHUNKS: Final = 64
"""Read at once from one vehicle, so that it can't keep the relay from the others."""
_HELLO_S: Final = 1.0


class VehiclePort:
    """The relay's own link to one vehicle. LinkError where its endpoint can't be opened."""

    def __init__(self, config: RelayVehicle, wire: Wire | None = None) -> None:
        self.config = config
        self.heard_s = -math.inf
        """When the vehicle's last frame came."""
        self.armed = False
        self.flown = False
        """It is armed, in the mode in which agents fly it."""
        self.signs = False
        """Its newest frame was signed: it obeys no other."""
        self.lost = 0
        """Frames to the vehicle that the machine refused."""
        self._wire = open_wire(config.endpoint) if wire is None else wire
        self._greets = config.endpoint.startswith("udpout:")
        self._framer = Framer(unknown=True)
        self._hello_s = -math.inf

    def take(self, now: float) -> list[bytes]:
        """The frames that have come from the vehicle itself; an ArduPilot forwards those of others,
        its agent's among them."""
        frames: list[bytes] = []
        for _ in range(_CHUNKS):
            try:
                chunk = self._wire.read(now)
            except OSError:
                continue
            if chunk is None:
                break
            frames += [frame.raw for frame in self._framer.feed(chunk) if self._is_own(frame)]
        if frames:
            self.heard_s = now
        self._greet(now)
        return frames

    def _is_own(self, frame: MavlinkFrame) -> bool:
        if frame.system != self.config.sysid:
            return False
        self.signs = frame.signed
        told = told_mode(frame)
        if told is not None:
            self.armed, self.flown = told.armed, flown_by_agent(told)
        return True

    def _greet(self, now: float) -> None:
        """An empty datagram, again and again (to an agent's mirror, the secret): a vehicle that
        listens sends to those it has heard. No HEARTBEAT: to a vehicle, the relay is nothing that
        lives or dies."""
        if self._greets and now - self._hello_s >= _HELLO_S:
            self._hello_s = now
            self._write(bytes.fromhex(self.config.secret), now)

    def passes(self, frame: MavlinkFrame) -> bool:
        """Whether a GCS may send it. Stream rates are a link's: on a shared one they are the
        agent's alone."""
        return not (self.config.shared and asks_for_streams(frame))

    def endangers(self, frame: MavlinkFrame) -> str:
        """What the frame would change of how the vehicle saves itself, while an agent flies it, or
        ''. A pilot who has taken it over may change all."""
        if not self.flown:
            return ""
        name = sets_parameter(frame)
        if name in GUARDED:
            return name
        return "a file" if writes_file(frame) else ""

    def give(self, frame: bytes, now: float) -> None:
        """Send a frame to the vehicle, or drop it; never waits."""
        self.lost += not self._write(frame, now)

    def _write(self, data: bytes, now: float) -> bool:
        try:
            self._wire.write(data, now)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the link."""
        self._wire.close()


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
    """Frames between vehicles and ground control software (GCS), by system id both ways.

    What a GCS sends is limited in rate, for each vehicle, and refused where it speaks with the
    system id of an agent or a vehicle, or would change what keeps a vehicle safe that an agent
    flies. `notes` are lines for the operator.
    """

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


_TURN_WALL_S: Final = 0.01
_LINGER_WALL_S: Final = 200.0
"""After the lifeline's end; vehicles come down in less."""
_NICE: Final = 5
"""Agents go first where the machine is busy."""


def relay(lifeline: PipeLifeline) -> int:
    """Carry frames until the lifeline has ended and all vehicles are down; the exit code."""
    os.nice(_NICE)
    config = read_launch(Path(sys.argv[1])).relay
    if config is None:
        raise StartError("this run has no ground control software")
    with contextlib.ExitStack() as opened:
        ports = [
            opened.enter_context(contextlib.closing(VehiclePort(vehicle)))
            for vehicle in config.vehicles
        ]
        sockets = [
            opened.enter_context(contextlib.closing(GcsSocket(station, wall_s())))
            for station in config.stations
        ]
        lifeline.tell(READY)
        carries = GcsRelay(ports, sockets)
        until: float | None = None
        while until is None or (wall_s() < until and carries.flying(wall_s())):
            carries.step(wall_s())
            for note in carries.notes:
                lifeline.tell(note)
                sys.stderr.write(f"{note}\n")
            carries.notes.clear()
            if until is None and lifeline.cut():
                until = wall_s() + _LINGER_WALL_S
            pause(_TURN_WALL_S)
        sys.stderr.write(f"{carries.account()}\n")
    return 0


if __name__ == "__main__":
    serve(relay)
