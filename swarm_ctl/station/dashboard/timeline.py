"""The line under a replay: where it is, what was told when; a click goes there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from swarm_ctl.station.dashboard.drawing.styled_line import LEVEL_STYLE, StyledLine
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import EntryKind
from swarm_ctl.station.picture.playback import Film

SPEEDS: Final = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)


@dataclass(frozen=True, slots=True)
class Playing:
    """How the film runs."""

    going: bool
    speed: float
    wanted_s: float | None = None
    """Where the operator wants to be, while the recording is not read so far yet."""


def at_speed(speed: float, by: int) -> float:
    """The next faster (1) or slower (-1) speed; the nearest there is where `by` is 0."""
    nearest = min(range(len(SPEEDS)), key=lambda k: abs(math.log(SPEEDS[k] / speed)))
    return SPEEDS[min(max(0, nearest + by), len(SPEEDS) - 1)]


def clock(time_s: float) -> str:
    """`01:02.3`."""
    minutes, tenths = divmod(int(10 * max(0.0, time_s) + 1e-6), 600)
    return f"{minutes:02d}:{tenths // 10:02d}.{tenths % 10}"


def timeline(film: Film, playing: Playing, width: int) -> StyledLine:
    """State and time on the left, speed on the right, the flight in between."""
    sign = "▶" if playing.going else "■" if film.time_s >= film.end_s else "‖"
    line = (
        StyledLine(" REPLAY ", "bold reverse", "app.pause")
        .add(f" {sign} ", "bold", "app.pause")
        .add(clock(film.time_s))
    )
    speed = f" ×{playing.speed:g} "
    end = f" {clock(film.end_s)}"
    if playing.wanted_s is not None:
        line.add(f" → {clock(playing.wanted_s)}", "cyan")
    room = width - line.width - len(end) - len(speed) - 1
    if room >= 10:
        line.add(" ").put(_rail(film, room))
    return line.add(end, "dim").to(width - len(speed)).add(speed, "bold")


def _rail(film: Film, room: int) -> StyledLine:
    """One cell for each part of the flight; ┼ a step begins, ▲ something to look at was told."""
    per_cell = (film.end_s - film.start_s) / (room - 1) or 1.0
    steps, levels = set[int](), dict[int, Level]()
    for mark in film.marks:
        cell = round((mark.time_s - film.start_s) / per_cell)
        if mark.kind is EntryKind.STEP:
            steps.add(cell)
        elif mark.level >= Level.WARNING:
            levels[cell] = max(levels.get(cell, Level.WELL), mark.level)
    here, known = ((t - film.start_s) / per_cell for t in (film.time_s, film.known_s))
    line = StyledLine()
    for cell in range(room):
        goes_to = f"app.seek({film.start_s + cell * per_cell:.2f})"
        passed, read = cell <= here, cell <= known
        if cell == round(here):
            line.add("●", "bold", goes_to)
        elif cell in levels:
            line.add("▲", LEVEL_STYLE[levels[cell]], goes_to)
        else:
            rail = (
                ("┿" if passed else "┼")
                if cell in steps
                else "━"
                if passed
                else "─"
                if read
                else "·"
            )
            line.add(rail, "cyan" if passed else "dim", goes_to)
    return line
