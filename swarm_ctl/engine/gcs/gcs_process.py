"""`python -m swarm_ctl.engine.gcs.gcs_process CONFIG`: serves ground control software (GCS).

A process of its own, so that a GCS that floods, hangs or dies takes no time from an agent. It
prints a line of JSON when ready, then one for each note to the operator. Stdin is the lifeline: at
its end the relay goes on until no vehicle is armed any more, so that a pilot sees them come down.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.gcs.config import RELAY_JSON
from swarm_ctl.engine.gcs.gcs_socket import GcsSocket
from swarm_ctl.engine.gcs.relay import GcsRelay
from swarm_ctl.engine.gcs.vehicle_port import VehiclePort
from swarm_ctl.errors import SwarmError

_TURN_WALL_S: Final = 0.01
_LINGER_WALL_S: Final = 200.0
"""After the lifeline's end; vehicles come down in less."""
_NICE: Final = 5
"""Agents go first where the machine is busy."""


def serve(relay: GcsRelay) -> None:
    """Carry frames until the lifeline has ended and all vehicles are down."""
    os.set_blocking(0, False)
    os.set_blocking(1, False)
    until: float | None = None
    while until is None or (wall_s() < until and relay.flying(wall_s())):
        relay.step(wall_s())
        _tell(relay.notes)
        if until is None and _told_to_end():
            until = wall_s() + _LINGER_WALL_S
        pause(_TURN_WALL_S)


def _told_to_end() -> bool:
    try:
        return not os.read(0, 4096)
    except BlockingIOError:
        return False


def _tell(notes: list[str]) -> None:
    """To `run`, if it reads, and to the log."""
    for note in notes:
        with contextlib.suppress(OSError):
            os.write(1, json.dumps({"note": note}).encode() + b"\n")
        sys.stderr.write(f"{note}\n")
    notes.clear()


def main(arguments: Sequence[str]) -> int:
    """The command; its exit code."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # only the lifeline, or SIGTERM, ends it
    os.nice(_NICE)
    config = RELAY_JSON.validate_json(Path(arguments[0]).read_bytes())
    try:
        with contextlib.ExitStack() as opened:
            ports = [
                opened.enter_context(contextlib.closing(VehiclePort(vehicle)))
                for vehicle in config.vehicles
            ]
            sockets = [
                opened.enter_context(contextlib.closing(GcsSocket(station, wall_s())))
                for station in config.stations
            ]
            os.write(1, b'{"ready": true}\n')
            relay = GcsRelay(ports, sockets)
            serve(relay)
            sys.stderr.write(f"{relay.account()}\n")
    except SwarmError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
