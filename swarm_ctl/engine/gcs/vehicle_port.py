"""The relay's own link to one vehicle."""

from __future__ import annotations

import math
from typing import Final

from swarm_ctl.engine.gcs.config import RelayVehicle
from swarm_ctl.mavlink.addressed import asks_for_streams, sets_parameter, told_mode, writes_file
from swarm_ctl.mavlink.autopilots import GUARDED, flown_by_agent
from swarm_ctl.mavlink.framer import Framer, MavlinkFrame
from swarm_ctl.mavlink.wires import Wire, open_wire

_CHUNKS: Final = 64
"""Read at once from one vehicle, so that it can't keep the relay from the others."""
_HELLO_S: Final = 1.0


class VehiclePort:
    """Frames of one vehicle, and frames to it. LinkError where its endpoint can't be opened."""

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
