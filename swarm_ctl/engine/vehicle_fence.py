"""Vehicles' own fences over real links: `mavlink/fence_items.py` with a wire and a clock."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from typing import Final

from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.link_keys import LinkKeys
from swarm_ctl.engine.ticker import Ticker
from swarm_ctl.mavlink.fence_items import FenceItem, FenceReport, FenceTransfer
from swarm_ctl.mavlink.wires import open_wire

_TICK_S: Final = 0.02


def transferred(
    endpoint: str, sysid: int, items: Sequence[FenceItem] | None, agent: int, keys: LinkKeys
) -> FenceReport:
    """Give the vehicle of an agent these items, or (None) read what it has.

    LinkError where the endpoint can't be opened, TrustError where its key can't be used.
    """
    ticker = Ticker(Clock.starting_now(), _TICK_S)
    with closing(open_wire(endpoint)) as wire, keys.signing(agent) as signing:
        work = FenceTransfer(wire, sysid, items, signing)
        while True:
            report = work.step(ticker.wait())
            if report is not None:
                return report
