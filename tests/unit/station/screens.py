"""The dashboard at rest, for snapshots. `python -m tests.unit.station.screens [FOLDER]` draws them
anew, and SVGs of them (light and dark) into FOLDER.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from textual.pilot import Pilot

from swarm_ctl.commands.parse import Order
from swarm_ctl.station.dashboard.app import Dashboard
from swarm_ctl.station.dashboard.key_bindings import SCREENS
from swarm_ctl.station.dashboard.themes import DARK, LIGHT
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.station.pictures import PICTURES

SIZES: Final = ((80, 24), (160, 50))
SHOWN: Final = {
    "well": SCREENS,
    "lost": SCREENS[:4],
    "crowd": SCREENS[:2],
    "waiting": SCREENS[:1],
    "groups": SCREENS[:1],
    "following": ("swarm", "swarm-whole", "swarm-south", "swarm-east"),
}
"""Which screens of which picture; behind a dash where the map is turned to."""


class Desk:
    """Keeps what the dashboard gave away."""

    def __init__(self) -> None:
        self.orders: list[Order] = []
        self.interrupts = 0

    def interrupt(self) -> None:
        """Count it."""
        self.interrupts += 1


@asynccontextmanager
async def opened(
    view: SwarmView, size: tuple[int, int] = (80, 24), *, owns_run: bool = True
) -> AsyncIterator[tuple[Dashboard, Pilot[None], Desk]]:
    """The dashboard on a terminal of this size, with its first view drawn."""
    desk = Desk()
    app = Dashboard(view.plan, desk.orders.append, desk.interrupt if owns_run else None)
    async with app.run_test(size=size) as pilot:
        await shown(app, pilot, view)
        yield app, pilot, desk


async def shown(app: Dashboard, pilot: Pilot[None], view: SwarmView) -> None:
    """Let it draw another view, and whatever that changes."""
    app.offer(view)
    await settled(pilot)


async def settled(pilot: Pilot[None]) -> None:
    """All that one thing sets off: a message, a new layout, a drawing in it."""
    for _ in range(3):
        await pilot.pause()


def text(app: Dashboard) -> str:
    """What stands on the terminal."""
    return "\n".join(strip.text for strip in app.screen._compositor.render_strips()) + "\n"


def snapshot_path(name: str, screen: str, size: tuple[int, int]) -> Path:
    """Where the text of a screen is kept."""
    return (
        Path(__file__).with_name("snapshots")
        / "dashboard"
        / f"{name}-{screen}-{size[0]}x{size[1]}.txt"
    )


async def drawn(name: str, size: tuple[int, int], svgs: Path | None = None) -> dict[str, str]:
    """Each screen of a picture as plain text; in both themes as SVG where a folder is given."""
    found = {}
    async with opened(PICTURES[name](), size) as (app, pilot, _):
        for screen in SHOWN[name]:
            pane, _, turned = screen.partition("-")
            app.action_go(pane)
            await settled(pilot)
            if turned:
                await pilot.press("v")
            found[screen] = text(app)
            for look, theme in (("dark", DARK), ("light", LIGHT)) if svgs else ():
                app.theme = theme
                await pilot.pause()
                path = Path(str(svgs)) / f"{name}-{screen}-{size[0]}x{size[1]}-{look}.svg"
                path.write_text(app.export_screenshot(title="swarm-ctl"), encoding="utf-8")
    return found


def main() -> None:
    """Draw everything."""
    svgs = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    for name in SHOWN:
        for size in SIZES:
            for screen, words in asyncio.run(drawn(name, size, svgs)).items():
                path = snapshot_path(name, screen, size)
                path.parent.mkdir(exist_ok=True)
                path.write_text(words, encoding="utf-8")


if __name__ == "__main__":
    main()
