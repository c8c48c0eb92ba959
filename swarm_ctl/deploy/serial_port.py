"""Whether this host's user can speak on the serial port of a vehicle."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path


def serial_port(endpoint: str) -> Iterator[str]:
    """Why this user can't speak on the serial port of an endpoint."""
    kind, _, rest = endpoint.partition(":")
    device = Path(rest.partition(":")[0])
    if kind != "serial":
        return
    if importlib.util.find_spec("serial") is None:
        yield "pyserial is missing: pip install 'swarm-ctl[serial]'"
    if not device.exists():
        yield f"{device} is not there: is the autopilot on, and plugged in?"
    elif not os.access(device, os.R_OK | os.W_OK):
        yield f"{device} is not this user's: sudo usermod -aG {device.group()} $USER, log in again"
