"""Draws the pictures of the dashboard: `python -m tests.scenarios.screenshots docs/pictures`.

Flies the hexagon with the slots crossed (so that agents meet and sigma has something to do) on the
virtual clock (real agents, drivers and simulator) and takes each screen, dark and light:
`dashboard-swarm-dark.svg` and so on.
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
from pathlib import Path
from typing import Any, Final

from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.station.dashboard.app import Dashboard
from swarm_ctl.station.dashboard.themes import DARK, LIGHT
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import SwarmView
from tests.scenarios.swarm import VirtualSwarm

SIZE: Final = (132, 36)
VIEW_EVERY_S: Final = 0.2
CHANNELS: Final[tuple[keys.Channel[Any], ...]] = (
    keys.STATE,
    keys.STATUS,
    keys.SIGMA,
    keys.EVENT,
    keys.ACK,
)


def main() -> None:
    """Fly, fold, draw."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mission", type=Path, default=Path("missions/hexagon.yaml"))
    parser.add_argument("--seconds", type=float, default=34.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        crossed = Path(name) / arguments.mission.name
        crossed.write_text(arguments.mission.read_text().replace("slots: nearest", "slots: fixed"))
        views = flown(crossed, arguments.seconds)
    busiest = max(range(len(views)), key=lambda k: (len(views[k].pairs), k))
    asyncio.run(draw(views[: busiest + 1], arguments.folder))


def flown(mission: Path, seconds: float) -> list[SwarmView]:
    """What a station saw, five times a mission second."""
    swarm = VirtualSwarm(load(mission))
    node = Node(MemoryTransport(swarm.mesh), "test", "picture")
    node.listen(*CHANNELS)
    model = Model(swarm.plan)
    views, due = [], 0.0
    while swarm.now < seconds:
        swarm.tick()
        for channel in CHANNELS:
            for payload, received_s in node.take(channel):
                model.fold(payload, received_s)
        if swarm.now >= due:
            due = swarm.now + VIEW_EVERY_S
            views.append(model.view(swarm.now))
    return views


async def draw(views: list[SwarmView], folder: Path) -> None:
    """Every screen at the last view; the log has seen all of them."""
    folder.mkdir(exist_ok=True)
    app = Dashboard(views[-1].plan, lambda _: None, lambda: None)
    async with app.run_test(size=SIZE) as pilot:
        for view in views:
            app.offer(view)
            await pilot.pause(0)
        for screen in ("swarm", "links", "sigma", "log"):
            app.action_go(screen)
            for look, theme in (("dark", DARK), ("light", LIGHT)):
                app.theme = theme
                for _ in range(3):
                    await pilot.pause()
                svg = app.export_screenshot(title="swarm-ctl run missions/hexagon.yaml")
                (folder / f"dashboard-{screen}-{look}.svg").write_text(svg, encoding="utf-8")


if __name__ == "__main__":
    main()
