"""Screens worth looking at. `python -m tests.unit.station.pictures [FOLDER]` draws the snapshots
anew, and SVGs of them (light and dark) into FOLDER.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.terminal_theme import DEFAULT_TERMINAL_THEME, MONOKAI

from swarm_ctl.core.model.messages import Ack, Command, Event, Phase
from swarm_ctl.station.output.live import render
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.station.swarm import flying_model, hexagon_plan, state_of, status_of

SIZES: Final = ((80, 24), (140, 40))
PLAN: Final = hexagon_plan()


@cache
def waiting() -> SwarmView:
    """Five agents wait for their vehicles, one has not been heard yet."""
    model = Model(PLAN)
    for agent in (1, 2, 3, 4, 5):
        reason = "PreArm: GPS 1: Bad fix" if agent < 5 else "no heartbeat yet"
        phase = Phase.PREPARE if agent < 5 else Phase.CONNECT
        mode = "STABILIZE" if agent < 5 else ""
        told = status_of(
            PLAN,
            agent,
            2.0,
            phase=phase,
            step=0,
            mode=mode,
            reason=reason,
            armed=False,
            airborne=False,
        )
        model.fold(told, 2.05)
    return model.view(2.1)


@cache
def well() -> SwarmView:
    """On the way into the hexagon, one pair in the avoidance region."""
    model = flying_model(PLAN)
    for agent in PLAN.agents:
        model.fold(Event(agent.id, 22.0, "info", "step 2: form hexagon"), 22.0)
    model.fold(Event(3, 24.0, "warning", "vehicle: EKF variance high"), 24.1)
    return model.view(30.0)


@cache
def lost() -> SwarmView:
    """Agent 3 has fallen silent, the others hold; the operator commands to land."""
    model = flying_model(PLAN)
    for agent in (1, 2, 4, 5, 6):
        for k in range(80):
            told = state_of(PLAN, agent, 30.0 + 0.05 * k, seq=1200 + k, phase=Phase.HOLD)
            model.fold(told, 30.01 + 0.05 * k)
        reason = "agent 3 has not been heard for 3 s"
        model.fold(
            status_of(PLAN, agent, 33.9, phase=Phase.HOLD, reason=reason, station_age_s=3.1), 33.9
        )
        model.fold(Event(agent, 33.0, "error", f"land: {reason}"), 33.1)
    model.fold(Command("c1", "land", (), 33.5), 33.5)
    for agent in (1, 2, 4, 5):
        model.fold(Ack(agent, "c1", True, ""), 33.6)
    model.fold(Ack(6, "c1", False, "agent 6 no longer flies its vehicle"), 33.6)
    return model.view(34.0)


@cache
def ended() -> SwarmView:
    """All down."""
    model = flying_model(PLAN)
    for agent in PLAN.agents:
        down = {"phase": Phase.ENDED, "step": 4, "done": True, "airborne": False}
        model.fold(state_of(PLAN, agent.id, 90.0, seq=2400, **down), 90.0)
        model.fold(
            status_of(PLAN, agent.id, 90.0, outcome="completed", mode="LAND", armed=False, **down),
            90.0,
        )
    return model.view(95.0)


@cache
def crowd() -> SwarmView:
    """32 agents, more than the screen has lines."""
    return flying_model(hexagon_plan(32)).view(30.0)


PICTURES: Final[dict[str, Callable[[], SwarmView]]] = {
    "waiting": waiting,
    "well": well,
    "lost": lost,
    "ended": ended,
    "crowd": crowd,
}


def snapshot_path(name: str, size: tuple[int, int]) -> Path:
    """Where the text of a picture is kept."""
    return Path(__file__).with_name("snapshots") / f"{name}-{size[0]}x{size[1]}.txt"


def recorded(view: SwarmView, width: int, height: int) -> Console:
    """A console that has drawn the view once."""
    console = Console(
        file=io.TextIOWrapper(io.BytesIO(), encoding="utf-8"),
        width=width,
        height=height,
        record=True,
        force_terminal=True,
        color_system="standard",
        legacy_windows=False,
    )
    console.print(render(view), end="")
    return console


def drawn(view: SwarmView, width: int, height: int) -> str:
    """The screen as plain text, `height` lines of `width` characters."""
    return recorded(view, width, height).export_text(styles=False).removesuffix("\n")


def main() -> None:
    """Draw everything."""
    for name, picture in PICTURES.items():
        for size in SIZES:
            snapshot_path(name, size).parent.mkdir(exist_ok=True)
            snapshot_path(name, size).write_text(drawn(picture(), *size), encoding="utf-8")
            for folder in map(Path, sys.argv[1:]):
                console = recorded(picture(), *size)
                for look, theme in (("dark", MONOKAI), ("light", DEFAULT_TERMINAL_THEME)):
                    path = folder / f"{name}-{size[0]}x{size[1]}-{look}.svg"
                    console.save_svg(str(path), title="swarm-ctl", theme=theme, clear=False)


if __name__ == "__main__":
    main()
