"""The dashboard: screens over one `SwarmView` after the other. It fetches nothing and decides
nothing: views come in from the station's thread, orders go out to it.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar, Final

from rich.terminal_theme import TerminalTheme
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Horizontal, Vertical
from textual.driver import Driver
from textual.events import Key, Resize
from textual.message import Message
from textual.screen import ModalScreen, Screen
from textual.widgets import Button, ContentSwitcher, Input, Label

from swarm_ctl.commands.parse import BY_NAME, KINDS, Order, parse
from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.errors import InputError
from swarm_ctl.station.dashboard.agent_table import TITLES, in_order, table_lines
from swarm_ctl.station.dashboard.bars import (
    SCREENS,
    command_line,
    keys_line,
    tabs_line,
    title_line,
    usage_line,
    verdict_line,
)
from swarm_ctl.station.dashboard.help_panel import help_lines
from swarm_ctl.station.dashboard.links_panel import METRICS, links_lines
from swarm_ctl.station.dashboard.log_panel import log_lines
from swarm_ctl.station.dashboard.map_panel import map_lines
from swarm_ctl.station.dashboard.picture import Chosen, Picture
from swarm_ctl.station.dashboard.sigma_panel import sigma_lines
from swarm_ctl.station.dashboard.styled_line import Line
from swarm_ctl.station.dashboard.widgets import CommandInput, Painted
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import Journal
from swarm_ctl.station.picture.view import SwarmView

_WIDE: Final = 120
"""From this width on the map stands beside the table, not under it."""
_LEVELS: Final = (Level.WELL, Level.WARNING, Level.ERROR)
DARK, LIGHT, PLAIN = "textual-dark", "textual-light", "ansi-dark"
"""Themes; the last one has the terminal's own colours, for `NO_COLOR`."""


_INKS: Final = TerminalTheme(
    (247, 247, 247),
    (0, 0, 0),
    [
        (0, 0, 0),
        (160, 30, 30),
        (30, 105, 20),
        (130, 85, 0),
        (30, 70, 160),
        (120, 40, 140),
        (0, 95, 135),
        (247, 247, 247),
    ],
    [
        (90, 90, 90),
        (200, 50, 50),
        (120, 200, 60),
        (250, 190, 60),
        (0, 100, 180),
        (190, 40, 190),
        (70, 190, 220),
        (255, 255, 255),
    ],
)
"""The sixteen colours on a light ground: the usual yellow, green and cyan can hardly be read
there."""


def _by_background() -> str:
    """Light where the terminal says so: `COLORFGBG` is `foreground;background`, of which 7 and 15
    are white."""
    return LIGHT if os.environ.get("COLORFGBG", "").rpartition(";")[2] in ("7", "15") else DARK


class NewView(Message):
    """A newer view waits."""


class Note(Message):
    """A word for the operator."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.text = text


class Over(Message):
    """The station has nothing to show any more."""


class Board(Screen[None], inherit_bindings=False):
    """The one screen below all: its tab key is ours."""


class Ask(ModalScreen[bool]):
    """One question before something that can't be taken back."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer(True)"),
        Binding("n,escape", "answer(False)"),
    ]

    def __init__(self, question: str) -> None:
        super().__init__()
        self._question = question

    def compose(self) -> ComposeResult:
        """The question and its answers."""
        with Vertical(id="ask"):
            yield Label(self._question, markup=False)
            with Horizontal():
                yield Button("y  yes", id="yes", variant="error", compact=True)
                yield Button("n  no", id="no", compact=True)

    def on_mount(self) -> None:
        """No key but `y` says yes."""
        self.set_focus(None)

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """A mouse's answer."""
        self.dismiss(event.button.id == "yes")

    def action_answer(self, yes: bool) -> None:
        """A key's answer."""
        self.dismiss(yes)


def _bindings() -> list[BindingType]:
    keys: list[BindingType] = [
        Binding("ctrl+c", "interrupt", priority=True),
        Binding("ctrl+q", "leave", priority=True),
        Binding("q", "leave"),
        Binding("question_mark,f1", "go('help')"),
        Binding("tab", "go_on(1)"),
        Binding("shift+tab", "go_on(-1)"),
        Binding("up,k", "cursor(-1)"),
        Binding("down,j", "cursor(1)"),
        Binding("pageup", "scroll(-1)"),
        Binding("pagedown", "scroll(1)"),
        Binding("space", "mark_cursor"),
        Binding("a", "mark_all"),
        Binding("s", "sort_next"),
        Binding("S", "sort_turn"),
        Binding("v", "metric_next"),
        Binding("slash", "begin('/')", priority=True),
        Binding("w", "level_next"),
        Binding("x", "acknowledge"),
        Binding("t", "theme"),
        Binding("colon", "begin(':')", priority=True),
        Binding("escape", "close_line"),
    ]
    keys += [Binding(str(k + 1), f"go('{name}')") for k, name in enumerate(SCREENS[:4])]
    for kind in KINDS:
        keys.append(
            Binding(kind.key, f"command('{kind.name} ')" if kind.usage else f"order('{kind.name}')")
        )
    return keys


class Dashboard(App[None]):
    """The application.

    `give` passes an order on; `interrupt` is what Ctrl-C means in the terminal of a `run`, None
    where this station only watches: then Ctrl-C leaves.
    """

    CSS = """
    Painted { height: 1; overflow: hidden; scrollbar-size-vertical: 1; }
    ContentSwitcher { height: 1fr; }
    #links, #sigma, #log, #help { height: 1fr; overflow-y: auto; }
    #log, #help { scrollbar-gutter: stable; }
    #swarm { height: 1fr; layout: vertical; }
    #left { height: auto; }
    #table { overflow-y: auto; }
    #map { height: 1fr; }
    #recent { display: none; }
    #swarm.wide { layout: horizontal; }
    #swarm.wide #left { height: 1fr; }
    #swarm.wide #recent { display: block; height: 1fr; }
    #swarm.wide #map { width: 1fr; height: 1fr; }
    #entry { display: none; height: 1; }
    #prompt { width: 2; padding-left: 1; text-style: bold; }
    #line { width: 1fr; height: 1; border: none; padding: 0; background: $background; }
    Ask { align: center middle; }
    #ask { width: auto; max-width: 90%; height: auto; padding: 1 2; border: heavy $error; background: $surface; }
    #ask Horizontal { height: auto; width: auto; padding-top: 1; }
    #ask Button { margin-right: 2; }
    """
    BINDINGS: ClassVar[list[BindingType]] = _bindings()
    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = None

    def __init__(
        self,
        plan: Plan,
        give: Callable[[Order], None],
        interrupt: Callable[[], None] | None,
        *,
        driver_class: type[Driver] | None = None,
    ) -> None:
        plain = "NO_COLOR" in os.environ
        super().__init__(driver_class=driver_class, ansi_color=True if plain else None)
        self.ansi_theme_light = _INKS
        self.theme = PLAIN if plain else os.environ.get("TEXTUAL_THEME", _by_background())
        self._plan = plan
        self._give = give
        self._interrupt = interrupt
        self._journal = Journal()
        self._waiting: SwarmView | None = None
        self._view: SwarmView | None = None
        self._chosen = Chosen()
        self._notice = ""
        self._shown = SCREENS[0]
        self._up = self._over = False
        self.frames_dropped = 0

    # --- the station's side, from its thread ---

    def offer(self, view: SwarmView) -> None:
        """Show this view soon; one that is still waiting was one too many for this terminal."""
        if self._waiting is not None:
            self.frames_dropped += self._up
            self._waiting = view
            return
        self._waiting = view
        self._post(NewView())

    def tell(self, text: str) -> None:
        """A word of the run."""
        self._post(Note(text))

    def leave(self) -> None:
        """All is over: close."""
        self._over = True
        self._post(Over())

    def _post(self, message: Message) -> None:
        if self._up:
            self.post_message(message)

    # --- the screen ---

    def get_default_screen(self) -> Screen[None]:
        """As `App.get_default_screen`."""
        return Board(id="_default")

    def compose(self) -> ComposeResult:
        """Bars above and below, one screen in between."""
        yield Painted("title")
        yield Painted("tabs")
        yield Painted("verdict")
        with ContentSwitcher(initial=self._shown):
            with Container(id="swarm"):
                with Vertical(id="left"):
                    yield Painted("table")
                    yield Painted("recent", follows=True)
                yield Painted("map")
            yield Painted("links")
            yield Painted("sigma")
            yield Painted("log", follows=True)
            yield Painted("help")
        yield Painted("answers")
        yield Painted("keys")
        with Horizontal(id="entry"):
            yield Label("", id="prompt", markup=False)
            yield CommandInput(self._plan)

    def on_mount(self) -> None:
        """A shell that takes the terminal back (our `run` was killed) must not stop us."""
        for number in (signal.SIGTTOU, signal.SIGTTIN):
            signal.signal(number, signal.SIG_IGN)

    def on_ready(self) -> None:
        """From here on messages are taken; what came before waits."""
        self._up = True
        self.on_new_view()
        if self._over:
            self.exit()

    def on_over(self) -> None:
        """Close."""
        self.exit()

    def on_note(self, message: Note) -> None:
        """Show and log it."""
        self._journal.note(self._view.time_s if self._view else 0.0, message.text)
        self._say(message.text)

    def on_new_view(self) -> None:
        """Take the newest view and draw it."""
        view, self._waiting = self._waiting, None
        if view is not None:
            health = replace(view.health, frames_dropped=self.frames_dropped)
            self._view = replace(view, health=health)
            self._journal.update(self._view)
            self.draw()

    def on_resize(self, event: Resize) -> None:
        """Lay the swarm's screen out for the new size."""
        wide = event.size.width >= _WIDE
        self.query_one("#swarm").set_class(wide, "wide")
        self.query_one("#left").styles.width = (
            (78 if event.size.width < 140 else 98) if wide else "1fr"
        )

    def on_painted_sized(self) -> None:
        """A panel was shown, hidden or resized: draw for its new room."""
        self.draw()

    @property
    def picture(self) -> Picture | None:
        """What is drawn now; None before the first view."""
        if self._view is None:
            return None
        standing = self._journal.standing
        seen = frozenset(alarm.key for alarm in standing if self._journal.is_acknowledged(alarm))
        return Picture(self._view, standing, seen, self._journal.entries, self._chosen)

    def draw(self) -> None:
        """Draw what is visible."""
        picture = self.picture
        if picture is None:
            return
        width = self.size.width
        self._painted("title").paint([title_line(picture, width)], width=width)
        self._painted("tabs").paint(
            [tabs_line(picture, self._shown, self._journal.unacknowledged, width)], width=width
        )
        verdict, back = verdict_line(picture, width)
        self._painted("verdict").paint([verdict], back, width=width)
        line = self.query_one(CommandInput)
        typed = line.value if line.purpose == "order" else None
        answer = (
            command_line(picture, self._notice) if typed is None else usage_line(typed, self._plan)
        )
        self._painted("answers").paint([answer], width=width)
        self._painted("keys").paint([self.keys_line(picture, width)], width=width)
        if self._shown == "swarm":
            self._draw_swarm(picture)
        else:
            panel = self._painted(self._shown)
            panel.paint(self._lines(picture, panel.room[0]))

    def keys_line(self, picture: Picture, width: int) -> Line:
        """The keys that matter on this screen."""
        return keys_line(picture, self._shown, owns_run=self._interrupt is not None, width=width)

    def help_lines(self, width: int) -> list[Line]:
        """The help screen."""
        return help_lines(width)

    def _lines(self, picture: Picture, width: int) -> list[Line]:
        match self._shown:
            case "links":
                return links_lines(picture, width)
            case "sigma":
                return sigma_lines(picture, width)
            case "log":
                return log_lines(picture, width)
            case _:
                return self.help_lines(width)

    def _draw_swarm(self, picture: Picture) -> None:
        table, recent = self._painted("table"), self._painted("recent")
        room = self.query_one("#swarm").size.height
        most = room - 4 if self.query_one("#swarm").has_class("wide") else max(4, room // 2)
        height = min(len(picture.view.agents) + 1, most)
        if table.styles.height is None or table.styles.height.value != height:
            table.styles.height = height  # the map has another size then, and says so
        table.paint(table_lines(picture, table.room[0]))
        if recent.display and recent.room[0] > 0:
            heading = Line("─ log ".ljust(recent.room[0], "─"), "dim")
            recent.paint([heading, *log_lines(picture, recent.room[0])[-(recent.room[1] - 1) :]])
        drawing = self._painted("map")
        drawing.paint(map_lines(picture, *drawing.room))

    def _painted(self, name: str) -> Painted:
        return self.query_one(f"#{name}", Painted)

    def _choose(self, **changes: object) -> None:
        self._chosen = replace(self._chosen, **changes)  # type: ignore[arg-type]
        self.draw()

    # --- moving about ---

    def action_go(self, name: str) -> None:
        """Another screen."""
        self._shown = name
        self.query_one(ContentSwitcher).current = name
        self.draw()

    def action_go_on(self, by: int) -> None:
        """The next screen."""
        self.action_go(SCREENS[(SCREENS.index(self._shown) + by) % len(SCREENS)])

    def action_scroll(self, pages: int) -> None:
        """Turn a page of the visible screen."""
        panel = self._painted("table" if self._shown == "swarm" else self._shown)
        (panel.scroll_page_up if pages < 0 else panel.scroll_page_down)(animate=False, force=True)

    def action_cursor(self, by: int) -> None:
        """The next row of the table, or line of another screen."""
        if self._shown != "swarm":
            panel = self._painted(self._shown)
            panel.scroll_relative(y=by, animate=False, force=True)
            return
        picture = self.picture
        if picture is None:
            return
        ids = [agent.id for agent in in_order(picture)]
        at = (
            ids.index(self._chosen.cursor)
            if self._chosen.cursor in ids
            else (-1 if by > 0 else len(ids))
        )
        place = min(max(0, at + by), len(ids) - 1)
        self._choose(cursor=ids[place])
        table = self._painted("table")
        row, (_, height), top = place + 1, table.room, table.scroll_offset.y
        if row < top + 1 or row >= top + height:
            table.scroll_to(y=max(0, row - height // 2), animate=False, force=True)

    def action_mark(self, agent: int) -> None:
        """A click on an agent: the cursor goes there, its mark changes."""
        self._choose(cursor=agent, marked=self._chosen.marked ^ {agent})

    def action_mark_cursor(self) -> None:
        """Mark the cursor's agent, or not."""
        if self._chosen.cursor:
            self.action_mark(self._chosen.cursor)

    def action_mark_all(self) -> None:
        """Mark everybody; nobody, where somebody is marked."""
        everybody = frozenset(agent.id for agent in self._plan.agents)
        self._choose(marked=frozenset() if self._chosen.marked else everybody)

    def action_sort(self, title: str) -> None:
        """Sort by a column; the same one again turns the order round."""
        again = title == self._chosen.sort
        self._choose(sort=title, backwards=again and not self._chosen.backwards)

    def action_sort_next(self) -> None:
        """Sort by the next column."""
        self._choose(
            sort=TITLES[(TITLES.index(self._chosen.sort) + 1) % len(TITLES)], backwards=False
        )

    def action_sort_turn(self) -> None:
        """Turn the order round."""
        self._choose(backwards=not self._chosen.backwards)

    def action_metric(self, name: str) -> None:
        """What the link matrix shows."""
        self._choose(metric=name)

    def action_metric_next(self) -> None:
        """The next thing it can show."""
        names = list(METRICS)
        self._choose(metric=names[(names.index(self._chosen.metric) + 1) % len(names)])

    def action_level_next(self) -> None:
        """The log from another level on."""
        self._choose(log_level=_LEVELS[(_LEVELS.index(self._chosen.log_level) + 1) % len(_LEVELS)])

    def action_theme(self) -> None:
        """Light or dark."""
        if self.theme != PLAIN:
            self.theme = LIGHT if self.current_theme.dark else DARK

    def action_acknowledge(self) -> None:
        """The operator has seen all alarms that stand."""
        if self._view is not None:
            count = self._journal.acknowledge(self._view.time_s)
            self._say(f"{count} alarms seen" if count else "no new alarms")

    def action_leave(self) -> None:
        """Only a station that watches can be left; the last one of a swarm that needs one asks
        first."""
        if self._interrupt is not None:
            self._say("this dashboard belongs to the run: Ctrl-C lands the swarm and ends it")
        elif (policy := self._alone()) and not isinstance(self.screen, Ask):
            question = f"leave? No other station is heard: the agents {policy.value} after"
            after_s = self._plan.policies.station_lost_after_s
            self.push_screen(
                Ask(f"{question} {after_s:g} s."), lambda yes: self.exit() if yes else None
            )
        else:
            self.exit()

    def _alone(self) -> Policy | None:
        """What the mission's policy will do when this station leaves; None where it changes
        nothing."""
        view, policy = self._view, self._plan.policies.station_lost
        if view is None or view.stations_there > 1 or policy is Policy.CONTINUE:
            return None
        return policy if any(agent.live for agent in view.agents) else None

    def action_interrupt(self) -> None:
        """Ctrl-C."""
        if self._interrupt is None:
            self.action_leave()
        else:
            self._interrupt()

    # --- orders ---

    def action_order(self, name: str) -> None:
        """An order without arguments, by its key."""
        self._order(name)

    def action_begin(self, character: str) -> None:
        """`:` and `/` open the line before the next key is looked at: typed fast, nothing behind
        them is an order."""
        line = self.query_one(CommandInput)
        if line.purpose:
            line.insert_text_at_cursor(character)
        elif isinstance(self.screen, Board):
            self.action_command("") if character == ":" else self.action_filter()

    def action_command(self, text: str) -> None:
        """Open the command line."""
        self._open_line("order", text)

    def action_filter(self) -> None:
        """Open the log's filter."""
        self.action_go("log")
        self._open_line("filter", self._chosen.log_words)

    def action_close_line(self) -> None:
        """Leave the command line; elsewhere: unmark, and drop the filter."""
        line = self.query_one(CommandInput)
        if line.purpose:
            self._close_line()
        elif self._shown == "log":
            self._choose(log_words="", log_level=Level.WELL)
        else:
            self._choose(marked=frozenset())

    async def on_key(self, event: Key) -> None:
        """A key that was on its way to the screen when the command line opened belongs to the line:
        nothing is lost."""
        line = self.query_one(CommandInput)
        if line.purpose and event.key == "enter":
            await line.action_submit()
        elif line.purpose and event.character and event.is_printable:
            line.insert_text_at_cursor(event.character)

    def on_input_changed(self, event: Input.Changed) -> None:
        """The filter works while it is typed."""
        if self.query_one(CommandInput).purpose == "filter":
            self._choose(log_words=event.value)
        else:
            self.draw()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter."""
        line = self.query_one(CommandInput)
        purpose, text = line.purpose, event.value.strip()
        self._close_line()
        if purpose not in ("", "filter") and text:
            line.remember(text)
            self.typed(text)

    def typed(self, text: str) -> None:
        """A line was typed behind a colon."""
        self._order(text)

    def _open_line(self, purpose: str, text: str) -> None:
        self._painted("keys").display = False
        self.query_one("#entry").display = True
        self.query_one("#prompt", Label).update("/" if purpose == "filter" else ":")
        self.query_one(CommandInput).open(purpose, text)
        self.draw()

    def _close_line(self) -> None:
        self.query_one(CommandInput).close()
        self.query_one("#entry").display = False
        self._painted("keys").display = True
        self.draw()

    def _order(self, text: str) -> None:
        try:
            order = parse(text, self._plan, self._chosen.marked)
        except InputError as error:
            self._say(str(error))
            return
        asks = BY_NAME[order.kind].asks
        self._notice = ""
        if not asks:
            self._give(order)
            return
        who = agents_named(order.agents or (agent.id for agent in self._plan.agents))

        def answered(yes: bool | None) -> None:
            if yes:
                self._give(order)
            else:
                self._say(f"{order.kind}: not sent")

        self.push_screen(Ask(f"{order.kind} {who}? {asks}"), answered)

    def _say(self, text: str) -> None:
        """A word to the operator, until the next one."""
        self._notice = text
        self.draw()
        self.set_timer(8.0, lambda: self._unsay(text))

    def _unsay(self, text: str) -> None:
        if self._notice == text:
            self._notice = ""
            self.draw()
