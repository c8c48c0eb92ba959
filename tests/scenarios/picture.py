"""Draws the README's picture: `python -m tests.scenarios.picture docs/live.svg`.

Flies the hexagon on the virtual clock (real agents, drivers and simulator) and draws what a ground
station shows after `--seconds` of mission time.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path
from typing import Any

from rich.console import Console

from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.station.output.live import render
from swarm_ctl.station.picture.model import Model
from tests.scenarios.swarm import VirtualSwarm

WIDTH, HEIGHT = 100, 22
CHANNELS: tuple[keys.Channel[Any], ...] = (
    keys.STATE,
    keys.STATUS,
    keys.SIGMA,
    keys.EVENT,
    keys.BEACON,
)


def main() -> None:
    """Fly, fold, draw."""
    parser = argparse.ArgumentParser()
    parser.add_argument("svg", type=Path)
    parser.add_argument("--mission", type=Path, default=Path("missions/hexagon.yaml"))
    parser.add_argument("--seconds", type=float, default=18.0)
    arguments = parser.parse_args()
    swarm = VirtualSwarm(load(arguments.mission))
    node = Node(MemoryTransport(swarm.mesh), "test", "picture")
    node.listen(*CHANNELS)
    model = Model(swarm.plan)
    while swarm.now < arguments.seconds:
        swarm.tick()
        for channel in CHANNELS:
            for payload, received_s in node.take(channel):
                model.fold(payload, received_s)
    console = Console(
        record=True, width=WIDTH, height=HEIGHT, file=io.StringIO(), force_terminal=True
    )
    console.print(render(model.view(swarm.now), WIDTH, HEIGHT))
    console.save_svg(str(arguments.svg), title="swarm-ctl run missions/hexagon.yaml")


if __name__ == "__main__":
    main()
