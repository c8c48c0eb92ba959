"""A recording played again: the dashboard with a player's keys, log lines or JSON lines."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import ValidationError

from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.station.printers import LogPrinter, write
from swarm_ctl.engine.station.screens import Show, possible
from swarm_ctl.errors import InputError
from swarm_ctl.recording import IndexedRecording, recover
from swarm_ctl.recording.mcap_reader import is_whole
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder.files import explained
from swarm_ctl.runfolder.manifest import Manifest
from swarm_ctl.signals import ended_by
from swarm_ctl.station.output.json_lines import json_line
from swarm_ctl.station.picture.playback import Film
from swarm_ctl.station.picture.view import SwarmView

if TYPE_CHECKING:
    from textual.driver import Driver

_JSON_WALL_S: Final = 1.0


def replay(run: Path, show: Show, speed: float, start: str) -> None:
    """Play the recording of `run` (a folder or an MCAP file) from the time `start` to its end.

    Raises:
        InputError: there is no recording of this program, or nothing in it.
    """
    with _opened(run) as film:
        film.seek(film.moment(start))
        match possible(show):
            case Show.DASHBOARD:
                _with_keys(film, speed)
            case Show.LOG:
                _play(film, LogPrinter().lines, speed, film.look_s)
            case Show.JSON:
                _play(film, lambda view: [json_line(view)], speed, _JSON_WALL_S * speed)


@contextlib.contextmanager
def _opened(run: Path) -> Iterator[Film]:
    """The film of a recording, as far as it can be read; of one that was cut off or is damaged, a
    whole copy is made for other tools, where that can be written."""
    with IndexedRecording(run) as tape:
        manifest = _manifest(run, tape)  # first of all: another program's file is not copied
        damage = tape.damage()
        said = [] if is_whole(run) else [f"{run}: was cut off; read up to its last second"]
        with contextlib.suppress(OSError):
            if copy := recover(run, damaged=damage.bad > 0):
                said.append(f"{copy}: a whole copy of what can be read, for other tools")
        said += damage.describe(str(run))
        sys.stderr.write("".join(f"{line}\n" for line in said))
        yield Film(
            tape, manifest.plan, speedup=manifest.speedup, station=tape.about.get("station", "")
        )


def _manifest(run: Path, tape: IndexedRecording) -> Manifest:
    try:
        return Manifest.model_validate_json(tape.about.get("manifest", ""))
    except ValidationError as error:
        raise InputError(
            f"{run}: the recording does not say what was flown: {explained(error)}"
        ) from None


def _with_keys(film: Film, speed: float) -> None:
    from swarm_ctl.station.dashboard.player import Player

    player = Player(film, wall.wall_s, speed=speed, driver_class=_driver())
    with ended_by(player.leave):
        player.run()


def _driver() -> type[Driver] | None:
    """None: Textual's own for this system."""
    if sys.platform == "win32":
        return None
    from swarm_ctl.station.dashboard.driver import TtyDriver

    return TtyDriver


def _play(
    film: Film, lines: Callable[[SwarmView], list[str]], speed: float, every_s: float
) -> None:
    """Write a view every so many mission seconds, and the last one."""
    start_s, began_s, shown = film.time_s, wall.wall_s(), 0
    rim = Rim("a view of the recording")
    while True:
        write(1, rim.run(lambda: lines(film.view())) or [])
        for trouble in rim.troubles():
            sys.stderr.write(f"{trouble.part} can't be told: {trouble.why}\n")
        if film.time_s >= film.end_s:
            return
        shown += 1
        film.seek(start_s + shown * every_s)
        wall.pause(max(0.0, began_s + (film.time_s - start_s) / speed - wall.wall_s()))
