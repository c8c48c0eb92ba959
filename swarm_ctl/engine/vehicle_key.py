"""Sets a vehicle's signing key up, or its fence, over a real link: `mavlink/key_setup.py` and
`mavlink/fence_items.py` with a wire and a clock."""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.link_keys import TOOL, LinkKeys, folder_signing
from swarm_ctl.engine.ticker import Ticker
from swarm_ctl.errors import InputError
from swarm_ctl.mavlink.fence_items import FenceItem, FenceReport, FenceTransfer
from swarm_ctl.mavlink.key_setup import KeyReport, KeySetup
from swarm_ctl.mavlink.stamp import read_key
from swarm_ctl.mavlink.wires import open_wire
from swarm_ctl.trust.identity import MAVLINK_KEY

_TICK_S: Final = 0.05
_HOST: Final = re.compile(r"\w+:(.*):\d+")


def refuse_network(endpoint: str) -> None:
    """InputError where a key would leave this computer over a network, which anyone there reads."""
    found = _HOST.fullmatch(endpoint)
    if endpoint.startswith("serial:") or found is None:
        return
    try:
        local = ipaddress.ip_address(socket.gethostbyname(found[1])).is_loopback
    except OSError:
        local = False
    if not local:
        raise InputError(
            f"--endpoint {endpoint}: the key would pass a network, where others can read it;"
            " allowed: serial:DEVICE, a loopback address, or --over-network"
        )


def set_up(endpoint: str, sysid: int, folder: Path, *, clear: bool) -> KeyReport:
    """Give a vehicle the key of an agent's folder, or take it off.

    LinkError where the endpoint can't be opened, TrustError where the key can't be used.
    """
    key = read_key(folder / MAVLINK_KEY)
    ticker = Ticker(Clock.starting_now(), _TICK_S)
    with closing(open_wire(endpoint)) as wire, folder_signing(folder, TOOL) as signing:
        work = KeySetup(wire, sysid, key, signing, clear=clear)
        while True:
            report = work.step(ticker.wait())
            if report is not None:
                return report


_FENCE_TICK_S: Final = 0.02


def transferred(
    endpoint: str, sysid: int, items: Sequence[FenceItem] | None, agent: int, keys: LinkKeys
) -> FenceReport:
    """Give the vehicle of an agent these items, or (None) read what it has.

    LinkError where the endpoint can't be opened, TrustError where its key can't be used.
    """
    ticker = Ticker(Clock.starting_now(), _FENCE_TICK_S)
    with closing(open_wire(endpoint)) as wire, keys.signing(agent) as signing:
        work = FenceTransfer(wire, sysid, items, signing)
        while True:
            report = work.step(ticker.wait())
            if report is not None:
                return report
