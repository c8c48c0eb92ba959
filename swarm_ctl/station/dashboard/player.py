"""The dashboard over a recording: the same screens, with the keys of a player instead of orders."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Final

from textual.binding import Binding, BindingType
from textual.driver import Driver

from swarm_ctl.commands.parse import KINDS
from swarm_ctl.errors import InputError
from swarm_ctl.station.dashboard.app import Dashboard
from swarm_ctl.station.dashboard.command_input import Purpose
from swarm_ctl.station.dashboard.drawing.styled_line import LEVEL_STYLE, StyledLine
from swarm_ctl.station.dashboard.drawing.widgets import Painted
from swarm_ctl.station.dashboard.key_bindings import MOVES, at_once, hidden
from swarm_ctl.station.dashboard.panes.help_pane import SIGNS, HelpPane
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import EntryKind
from swarm_ctl.station.picture.playback import Film, Mark

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


_TICK_WALL_S: Final = 0.1
_WORK_WALL_S: Final = 0.04
"""How long reading on may keep the screen waiting."""
_NO_ORDERS: Final = "this is a recording: nothing can be ordered"
_KEYS: Final = f"""
space | pause, go on; at the end: once more from the start
← → | 5 s back, 5 s on; with shift 30 s
, . | a quarter of a second back, on
home end | start, end
e E | next event of any kind, the last one
a A | next alarm or warning, the last one
- + 0 | slower, faster (0.25 to 50), 1: mission seconds in seconds
: | go to a time: 83, 1:23, +10, -10, end; or click on the line below
1 2 3 4 ? | screens: swarm, links, sigma, log, help; also tab, or a click
↑ ↓ | move the cursor, or the lines of a screen
s S v / w | sort, reverse the order; swarm: where the map is seen from, links: what the matrix
  shows; filter the log by words, by level
t q | light or dark; leave
replay | {_NO_ORDERS}; alarms come as they would have come in flight
"""


def _bindings() -> list[BindingType]:
    shown = [
        Binding("space", "pause", "pause"),
        Binding("left", "skip(-5)", "5 s back"),
        Binding("right", "skip(5)", "on"),
        Binding("e", "next(False)", "event"),
        Binding("a", "next(True)", "alarm"),
        Binding("minus", "speed(-1)", "slower", key_display="-"),
        Binding("plus,equals_sign", "speed(1)", "faster", key_display="+"),
        Binding("colon", "command('')", "go to"),
        Binding("q", "leave", "leave"),
        Binding("slash", "look_for", show=False),
        Binding("v", "metric_next", show=False),
        Binding("v", "turn_map", show=False),
        Binding("ctrl+c", "interrupt", show=False),
        Binding("ctrl+q", "leave", show=False),
    ]
    keys = {
        "shift+left": "skip(-30)",
        "shift+right": "skip(30)",
        "comma": "skip(-0.25)",
        "full_stop": "skip(0.25)",
        "home": "seek(-1)",
        "end": "seek(1e9)",
        "E": "last(False)",
        "A": "last(True)",
        "0": "usual_speed",
        "s": "sort_next",
        "S": "sort_turn",
        "w": "level_next",
        "t": "theme",
    }
    orders = {kind.key: f"refuse('{kind.name}')" for kind in KINDS}
    return at_once([*shown, *hidden(keys | orders | MOVES)])


class Player(Dashboard, inherit_bindings=False):
    """Plays a film. `wall_s` is a clock that a person waits by [s]."""

    BINDINGS: ClassVar[list[BindingType]] = _bindings()

    def __init__(
        self,
        film: Film,
        wall_s: Callable[[], float],
        *,
        speed: float = 1.0,
        going: bool = True,
        driver_class: type[Driver] | None = None,
    ) -> None:
        super().__init__(film.plan, lambda _: None, None, driver_class=driver_class)
        self.film = film
        self.playing = Playing(going, at_speed(speed, 0))
        self._wall_s = wall_s
        self._last_s = wall_s()
        self._drawn = (-1.0, -1.0)

    def on_mount(self) -> None:
        """The line of time, and the film on it."""
        self.mount(Painted("timeline"), before="#keys")
        self.set_interval(_TICK_WALL_S, self.turn)

    def _alone(self) -> None:
        """A film may be left at any time."""

    def turn(self) -> None:
        """Go on as the wall clock does, read ahead in what is left of the time, draw what is
        new."""
        now_s = self._wall_s()
        passed_s, self._last_s = now_s - self._last_s, now_s

        def enough() -> bool:
            return self._wall_s() - now_s > _WORK_WALL_S

        film, wanted_s = self.film, self.playing.wanted_s
        if wanted_s is None and self.playing.going:
            film.seek(film.time_s + passed_s * self.playing.speed, enough)
            if film.time_s >= film.end_s:
                self._change(going=False)
        read = film.read_ahead(enough)
        if wanted_s is not None and (read or film.known_s >= wanted_s):
            self._change(wanted_s=None)
            film.seek(wanted_s)
        if (film.time_s, film.known_s) != self._drawn:
            self._drawn = (film.time_s, film.known_s)
            self._view, self._journal = film.view(), film.journal
            self.draw()

    def draw(self) -> None:
        super().draw()
        for line in self.query("#timeline").results(Painted):
            width = self.size.width
            line.paint([timeline(self.film, self.playing, width)], width=width)

    def help_pane(self) -> HelpPane:
        return HelpPane({"keys": _KEYS, "signs": SIGNS})

    # --- keys ---

    def action_pause(self) -> None:
        """Stop, go on; from the end: from the start."""
        if not self.playing.going and self.film.time_s >= self.film.end_s:
            self.film.seek(self.film.start_s)
        self._change(going=not self.playing.going, wanted_s=None)

    def action_seek(self, time_s: float) -> None:
        """Go there; at once, or as soon as the recording is read so far."""
        self._change(wanted_s=min(max(time_s, self.film.start_s), self.film.end_s))
        self.turn()

    def action_skip(self, seconds: float) -> None:
        """So far on or back from here, or from where we are going."""
        here_s = self.film.time_s if self.playing.wanted_s is None else self.playing.wanted_s
        self.action_seek(here_s + seconds)

    def action_next(self, bad: bool) -> None:
        """The next event; `bad`: the next alarm, warning or error."""
        time_s = self.film.next_mark(_wanted(bad))
        if time_s is not None:
            self.action_seek(time_s)
        elif self.film.read_ahead(lambda: True):
            self._say(f"no {'alarm' if bad else 'event'} after this moment")
        else:
            self._say("the recording is still being read")

    def action_last(self, bad: bool) -> None:
        time_s = self.film.last_mark(_wanted(bad))
        if time_s is None:
            self._say(f"no {'alarm' if bad else 'event'} before this moment")
        else:
            self.action_seek(time_s)

    def action_speed(self, by: int) -> None:
        self._change(speed=at_speed(self.playing.speed, by))

    def action_usual_speed(self) -> None:
        self._change(speed=1.0)

    def action_refuse(self, name: str) -> None:
        self._say(f"{name}: {_NO_ORDERS}")

    def action_command(self, _: str) -> None:
        self._open_line(Purpose.TIME, "")

    def typed(self, text: str) -> None:
        try:
            self.action_seek(self.film.moment(text))
        except InputError as error:
            orders = {kind.name for kind in KINDS}
            self._say(f"{text}: {_NO_ORDERS}" if text.split()[0] in orders else str(error))

    def _change(self, **changes: object) -> None:
        self.playing = replace(self.playing, **changes)  # type: ignore[arg-type]
        self.draw()


def _wanted(bad: bool) -> Callable[[Mark], bool]:
    return lambda mark: mark.level >= Level.WARNING if bad else True
