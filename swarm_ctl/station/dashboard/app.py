"""The dashboard: screens over one `SwarmView` after the other. It fetches nothing and decides
nothing: views come in from the station's thread, orders go out to it.
"""

from __future__ import annotations

import itertools
import math
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import ClassVar, Final, TypeVar

from textual.app import App, ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal
from textual.css.query import NoMatches
from textual.driver import Driver
from textual.events import Event, Key, Paste
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import DataTable, Footer, Input, Label, TabbedContent

from swarm_ctl.commands.parse import Order, parse
from swarm_ctl.core.model.messages import CommandKind, Phase
from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.errors import InputError
from swarm_ctl.rim import Rim, explained
from swarm_ctl.station.dashboard.ask import Ask, consequence
from swarm_ctl.station.dashboard.bars import (
    answers_line,
    protection_line,
    title_line,
    usage_line,
    verdict_line,
)
from swarm_ctl.station.dashboard.command_input import CommandInput, Purpose
from swarm_ctl.station.dashboard.drawing.picture import Chosen, NewZone, Picture
from swarm_ctl.station.dashboard.drawing.styled_line import ALARM_STYLE, StyledLine
from swarm_ctl.station.dashboard.drawing.widgets import Painted
from swarm_ctl.station.dashboard.key_bindings import ALWAYS, ONLY_ON, SCREENS, bindings
from swarm_ctl.station.dashboard.panes.agent_table import AgentTable, in_order, titles
from swarm_ctl.station.dashboard.panes.help_pane import KEYS, SIGNS, HelpPane, commands
from swarm_ctl.station.dashboard.panes.link_matrix import METRICS
from swarm_ctl.station.dashboard.panes.links_pane import LinksPane
from swarm_ctl.station.dashboard.panes.log_pane import LogPane
from swarm_ctl.station.dashboard.panes.pane import Pane
from swarm_ctl.station.dashboard.panes.sigma_pane import SigmaPane
from swarm_ctl.station.dashboard.panes.swarm_map import SIDES
from swarm_ctl.station.dashboard.panes.swarm_pane import SwarmPane
from swarm_ctl.station.dashboard.themes import (
    CSS,
    DARK,
    DARK_INKS,
    LIGHT,
    LIGHT_INKS,
    PLAIN,
    by_background,
)
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.colours import ON_DARK, ON_LIGHT
from swarm_ctl.station.picture.journal import Journal
from swarm_ctl.station.picture.view import SwarmView

_LEVELS: Final = (Level.WELL, Level.WARNING, Level.ERROR)
T = TypeVar("T")
_NOTICE_WALL_S: Final = 8.0
_ARROWS: Final = {"up": (1, 0), "down": (-1, 0), "right": (0, 1), "left": (0, -1)}
"""(north, east)."""
_SIZES: Final = {"plus": 1, "equals_sign": 1, "minus": -1}
_FAR: Final = 5
"""Strides of an arrow with shift."""
_FIRST_STRIDES: Final = 2
"""The radius of a zone before it is sized."""


def _circle(new: NewZone) -> str:
    """In the words of its order."""
    (north, east), radius = new.centre_m, new.radius_m
    return f"circle {north:g} {east:g} {radius:g}"


def _typed(event: Event) -> Key | Paste | None:
    """What came from the keyboard, unless it means the same whatever is open."""
    if not isinstance(event, Key | Paste) or event.is_forwarded:
        return None
    return None if isinstance(event, Key) and event.key in ALWAYS else event


class Board(Screen[None], inherit_bindings=False):
    """The one screen below all: its tab key is ours."""


def _after(value: T, values: Sequence[T], by: int = 1) -> T:
    """The next one, round and round."""
    return values[(values.index(value) + by) % len(values)]


class Dashboard(App[None]):
    """The application.

    `give` passes an order on; `interrupt` is what Ctrl-C means in the terminal of a `run`, None
    where this station only watches: then Ctrl-C leaves.
    """

    CSS = CSS
    BINDINGS: ClassVar[list[BindingType]] = bindings()
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
        self.animation_level = "none"
        self.ansi_theme_light, self.ansi_theme_dark = LIGHT_INKS, DARK_INKS
        self.theme = PLAIN if plain else os.environ.get("TEXTUAL_THEME", by_background())
        self._plan = plan
        self._give = give
        self._interrupt = interrupt
        self._interrupted = False
        self._journal = Journal()
        self._journal_rim = Rim("alarms and log")
        self._drawing: dict[str, Rim] = {}
        """By the part of the screen."""
        self._waiting: SwarmView | None = None
        self._view: SwarmView | None = None
        self._chosen = Chosen()
        self._notice = ""
        self._unsay_timer: Timer | None = None
        self._question: Ask | None = None
        self._question_seen = False
        self._early: list[str] = []
        """Words that were told before there was a screen."""
        self._up = self._over = False
        self.frames_dropped = 0
        self.failure = ""
        """The error that ended it; '' for none."""
        if interrupt is None:
            keys = self._bindings.key_to_bindings
            keys["ctrl+c"] = [replace(key, description="leave") for key in keys["ctrl+c"]]

    # --- the station's side, from its thread ---

    def offer(self, view: SwarmView) -> None:
        """Show this view soon; a view that still waits was one too many for this terminal."""
        if self._waiting is not None:
            self.frames_dropped += self._up
            self._waiting = view
            return
        self._waiting = view
        if self._up:
            self.call_later(self.take)

    def tell(self, text: str) -> None:
        """Show and log a word of the run."""
        if self._up:
            self.call_later(self._note, text)
        else:
            self._early.append(text)

    def leave(self) -> None:
        """All is over: close."""
        self._over = True
        if self._up:
            self.call_later(self.exit)

    # --- the screen ---

    def _handle_exception(self, error: Exception) -> None:
        """End at once. Textual's own would draw each error with all its variables, for seconds,
        while the station waits for the processor; a test gets it."""
        if self.is_headless:
            super()._handle_exception(error)
            return
        self._return_code = 1
        if not self.failure:
            self.failure = explained(error)
            self._close_messages_no_wait()

    def get_default_screen(self) -> Screen[None]:
        return Board(id="_default")

    def help_pane(self) -> HelpPane:
        return HelpPane({"commands, by key or after ':'": commands(), "keys": KEYS, "signs": SIGNS})

    def compose(self) -> ComposeResult:
        yield Painted("title")
        yield Painted("protection")
        yield Painted("verdict")
        with TabbedContent(initial=SCREENS[0]):
            yield SwarmPane("1 Swarm", id="swarm")
            yield LinksPane("2 Links", id="links")
            yield SigmaPane("3 Sigma", id="sigma")
            yield LogPane("4 Log", id="log")
            yield self.help_pane()
        yield Painted("answers")
        yield Painted("question")
        with Horizontal(id="keys"):
            yield Label("", id="marked", markup=False)
            yield Footer(compact=True, show_command_palette=False)
        with Horizontal(id="entry"):
            yield Label("", id="prompt", markup=False)
            yield CommandInput(self._plan)

    def on_mount(self) -> None:
        """A shell that takes the terminal back (our `run` was killed) must not stop us."""
        if sys.platform != "win32":
            for number in (signal.SIGTTOU, signal.SIGTTIN):
                signal.signal(number, signal.SIG_IGN)

    def on_ready(self) -> None:
        """From here on messages are taken; what came before waits."""
        self.query_one("ContentTabs").can_focus = False
        self.theme_changed_signal.subscribe(self, lambda _: self.draw())
        self._up = True
        self.take()
        for text in self._early:
            self._note(text)
        if self._over:
            self.exit()

    def take(self) -> None:
        """Take the newest view and draw it."""
        view, self._waiting = self._waiting, None
        if view is not None:
            health = replace(view.health, frames_dropped=self.frames_dropped)
            self._view = replace(view, health=health)
            self._journal_rim.run(self._journal.update, self._view)
            self.draw()
            for rim in (self._journal_rim, *self._drawing.values()):
                for trouble in rim.troubles():
                    self._note(str(trouble))

    def _note(self, text: str) -> None:
        self._journal.note(self._view.time_s if self._view else 0.0, text)
        self._say(text)

    def on_painted_sized(self) -> None:
        """A panel was shown, hidden or resized: draw for its new room."""
        self.draw()

    @property
    def picture(self) -> Picture | None:
        """What is drawn now; None before the first view."""
        if self._view is None:
            return None
        journal = self._journal
        return Picture(
            self._view,
            journal.standing,
            journal.entries,
            journal.unacknowledged,
            self._chosen,
            trends=journal.trends,
            palette=ON_DARK if self.current_theme.dark else ON_LIGHT,
        )

    @property
    def pane(self) -> Pane | None:
        """The screen that is shown; None before there is one."""
        tabs = self.query(TabbedContent)
        pane = tabs.first().active_pane if tabs else None
        return pane if isinstance(pane, Pane) else None

    def draw(self) -> None:
        picture, pane = self.picture, self.pane
        if picture is None or pane is None or not self._whole():
            return
        width = self.size.width
        self._try("title", lambda: self._paint("title", title_line(picture, width)))
        self._try("protection", lambda: self._draw_protection(picture))
        self._try("verdict", lambda: self._paint("verdict", *verdict_line(picture, width)))
        self._try("answers", self._draw_below)
        self._try("log", lambda: self._label(picture))
        self._try(str(pane.id), lambda: pane.draw(picture))

    def _try(self, name: str, draw: Callable[[], None]) -> None:
        """Draw a part of the screen; the others are drawn whatever happens there."""
        rim = self._drawing.setdefault(name, Rim(f"the {name} part of the dashboard"))
        before = rim.count
        rim.run(draw)
        if rim.count > before and self.query(f"#{name}") and name in ("title", "verdict"):
            line = StyledLine(f" the {name} can't be drawn; see the log", "red")
            rim.run(self._paint, name, line)

    def _draw_protection(self, picture: Picture) -> None:
        protection, back = protection_line(picture)
        self.query_one("#protection").display = protection.width > 0
        self._paint("protection", protection, back)

    def _whole(self) -> bool:
        """All widgets are there, the first and the last: not so while the app begins or ends."""
        try:
            self.query_one("#title")
            self.query_one("#entry")
        except NoMatches:
            return False
        return True

    def _draw_below(self) -> None:
        """The lines below the screen: all that a key on the command line changes."""
        picture, width = self.picture, self.size.width
        if picture is not None:
            lines = self._words_below(picture).folded(self.console, width)
            self.query_one("#answers", Painted).paint(lines, "", width)
        if self._question is not None:
            lines = self._question.lines(width, answered=self._question_seen)
            self.query_one("#question", Painted).paint(lines, ALARM_STYLE[Level.ERROR], width)

    def _paint(self, name: str, line: StyledLine, back: str = "") -> None:
        self.query_one(f"#{name}", Painted).paint([line], back, self.size.width)

    def _words_below(self, picture: Picture) -> StyledLine:
        """What can be typed; else what the station has to say; else the newest command's
        answers."""
        line = self.query_one(CommandInput)
        if line.purpose is Purpose.COMMAND:
            return usage_line(line.value, self._plan)
        if self._notice:
            return StyledLine(f" {self._notice}", "cyan")
        return answers_line(picture)

    def _label(self, picture: Picture) -> None:
        """New alarms on the log's tab; which agents a command goes to."""
        new, marked = picture.unacknowledged, len(self._chosen.marked)
        tab = self.query_one(TabbedContent).get_tab("log")
        words = f"4 Log {new}!" if new else "4 Log"
        if str(tab.label) != words:
            tab.label = words
        ended = all(agent.phase is Phase.ENDED for agent in picture.view.agents)
        words = " all agents have ended: " if ended else f" {marked} marked: " if marked else ""
        label = self.query_one("#marked", Label)
        if str(label.content) != words:
            label.update(words)

    def _choose(self, **changes: object) -> None:
        self._chosen = replace(self._chosen, **changes)  # type: ignore[arg-type]
        self.draw()

    # --- moving about ---

    async def on_event(self, event: Event) -> None:
        """Each key is answered before the next one is looked at, however fast they come: by the
        question that stands, else by the open line, else as a key of the screen. What is typed
        before there is a screen is dropped."""
        typed = _typed(event)
        if typed is None:
            await super().on_event(event)
        elif self._question is not None:
            self._answer(isinstance(typed, Key) and typed.key == "enter")
        elif self._up and (line := self.query_one(CommandInput)).purpose:
            await self._type(line, typed)
        elif self._up and not (isinstance(typed, Key) and self._move_zone(typed.key)):
            await super().on_event(event)

    async def _type(self, line: CommandInput, typed: Key | Paste) -> None:
        if isinstance(typed, Paste):
            line.insert_text_at_cursor(next(iter(typed.text.splitlines()), ""))
        elif typed.key == "enter":
            self._submit(line)
        elif typed.key == "escape" or typed.key.startswith("alt+"):
            # alt and a key: or escape and a key, which a stalled terminal reads at once
            self._close_line()
        else:
            await line.press(typed)

    def check_action(self, action: str, _: tuple[object, ...]) -> bool | None:
        """Some keys belong to one screen."""
        pane = self.pane if action in ONLY_ON else None
        return pane is None or pane.id == ONLY_ON[action]

    def on_tabbed_content_tab_activated(self) -> None:
        self.refresh_bindings()
        self.draw()

    def action_go(self, name: str) -> None:
        self.query_one(TabbedContent).active = name

    def action_go_on(self, by: int) -> None:
        self.action_go(_after(self.query_one(TabbedContent).active, SCREENS, by))

    def action_scroll(self, pages: int) -> None:
        if self.pane is not None:
            scroller = self.pane.scroller
            turn = scroller.scroll_page_up if pages < 0 else scroller.scroll_page_down
            turn(animate=False, force=True)

    def action_cursor(self, by: int) -> None:
        """The next row of the table, or line of another screen."""
        picture, pane = self.picture, self.pane
        if picture is None or pane is None:
            return
        if not isinstance(pane, SwarmPane):
            pane.scroller.scroll_relative(y=by, animate=False, force=True)
            return
        ids = [agent.id for agent in in_order(picture)]
        before = -1 if by > 0 else len(ids)
        at = ids.index(self._chosen.cursor) if self._chosen.cursor in ids else before
        self._choose(cursor=ids[min(max(0, at + by), len(ids) - 1)])

    def action_mark(self, agent: int) -> None:
        """A click on an agent: the cursor goes there, its mark changes."""
        self._choose(cursor=agent, marked=self._chosen.marked ^ {agent})

    def action_mark_cursor(self) -> None:
        if self._chosen.cursor:
            self.action_mark(self._chosen.cursor)

    def action_mark_all(self) -> None:
        """Mark all agents; none, where any is marked."""
        every = frozenset(agent.id for agent in self._plan.agents)
        self._choose(marked=frozenset() if self._chosen.marked else every)

    def on_data_table_header_selected(self, event: DataTable.HeaderSelected) -> None:
        """A click on a title sorts; the same one again turns the order round."""
        table = event.data_table
        if isinstance(table, AgentTable) and event.column_index < len(table.titles):
            title = table.titles[event.column_index]
            again = title == self._chosen.sort
            self._choose(sort=title, backwards=again and not self._chosen.backwards)

    def action_sort_next(self) -> None:
        self._choose(sort=_after(self._chosen.sort, titles(self._plan)), backwards=False)

    def action_sort_turn(self) -> None:
        self._choose(backwards=not self._chosen.backwards)

    def action_metric(self, name: str) -> None:
        self._choose(metric=name)

    def action_metric_next(self) -> None:
        self._choose(metric=_after(self._chosen.metric, tuple(METRICS)))

    def action_turn_map(self) -> None:
        self._choose(seen_from=_after(self._chosen.seen_from, tuple(SIDES)))

    def action_level_next(self) -> None:
        self._choose(log_level=_after(self._chosen.log_level, _LEVELS))

    def action_theme(self) -> None:
        if self.theme != PLAIN:
            self.theme = LIGHT if self.current_theme.dark else DARK

    def action_acknowledge(self) -> None:
        """The operator has seen all alarms that stand."""
        if self._view is not None:
            count = self._journal.acknowledge(self._view.time_s)
            self._say(f"{count} alarms seen" if count else "no new alarms")

    def action_leave(self) -> None:
        """Only a station that watches can be left; the last one of a swarm that needs one asks
        first, and the same key again is a yes."""
        asked = self._question is not None and self._question.do == self.exit
        if self._interrupt is not None:
            self._say("this dashboard belongs to the run: Ctrl-C lands the swarm and ends it")
        elif (policy := self._alone()) and not asked:
            after_s = self._plan.policies.station_lost_after_s
            words = (
                f"leave? No other station is heard: the agents {policy.value} after {after_s:g} s"
            )
            self._ask(Ask(words, "Enter leaves, Esc stays.", self.exit, "not left"))
        else:
            self.exit()

    def _alone(self) -> Policy | None:
        """What the mission's policy will do when this station leaves; None where it changes
        nothing."""
        view, policy = self._view, self._plan.policies.station_lost
        if view is None or view.stations_there > 1 or policy is Policy.CONTINUE:
            return None
        flying = (agent.live and agent.phase is not Phase.ENDED for agent in view.agents)
        return policy if any(flying) else None

    def action_interrupt(self) -> None:
        if self._interrupt is None:
            self.action_leave()
        elif not self._interrupted:
            self._interrupted = True
            self._answer(False)
            self._interrupt()
        elif self._question is None or self._question.do != self._interrupt:
            # held, the key comes again and again: it does not answer
            words = "the swarm lands already: stop at once, whatever is in the air"
            keys = "Enter stops, Esc lets it land."
            self._ask(Ask(words, keys, self._interrupt, "it lands on; only Enter stops"))

    # --- a zone from the map ---

    def action_place_zone(self) -> None:
        """A circle on the middle of the map, which keys and clicks move and size until it is
        ordered or dropped."""
        picture, pane = self.picture, self.pane
        if picture is None or not isinstance(pane, SwarmPane):
            return
        if all(agent.state is None for agent in picture.view.agents):
            self._say("no positions yet: no map to place a zone on")
            return
        scale = pane.map_scale(picture)
        centre_m = scale.point(scale.width // 2, scale.height // 2)
        self._put_zone(NewZone(centre_m, _FIRST_STRIDES * scale.stride_m))

    def _put_zone(self, new: NewZone) -> None:
        self._choose(new_zone=new)
        words = "arrows or a click move it, + - size it, Enter opens its order, Esc drops it"
        self._say(f"zone {_circle(new)}: {words}", math.inf)

    def _move_zone(self, key: str) -> bool:
        """Whether the key was for the zone that is being placed."""
        new, picture, pane = self._chosen.new_zone, self.picture, self.pane
        if new is None or picture is None or not isinstance(pane, SwarmPane):
            return False
        stride = pane.map_scale(picture).stride_m
        (north, east), direction = new.centre_m, key.rpartition("+")[2]
        if direction in _ARROWS:
            up, right = _ARROWS[direction]
            stride *= _FAR if key.startswith("shift+") else 1
            self._put_zone(replace(new, centre_m=(north + up * stride, east + right * stride)))
        elif key in _SIZES:
            self._put_zone(replace(new, radius_m=max(stride, new.radius_m + _SIZES[key] * stride)))
        elif key in ("enter", "escape"):
            self._choose(new_zone=None)
            self._unsay()
            if key == "enter":
                names = {zone.name for zone in picture.view.zones}
                name = next(f"zone-{k}" for k in itertools.count(1) if f"zone-{k}" not in names)
                self.action_command(f"zone add {name} {_circle(new)}")
        else:
            return False
        return True

    def on_painted_clicked(self, event: Painted.Clicked) -> None:
        """A click on the map moves the zone that is being placed."""
        new, picture, pane = self._chosen.new_zone, self.picture, self.pane
        if event.name != "map" or new is None or picture is None:
            return
        if isinstance(pane, SwarmPane):
            centre_m = pane.map_scale(picture).point(event.column, event.row)
            self._put_zone(replace(new, centre_m=centre_m))

    # --- orders ---

    def action_order(self, name: str) -> None:
        """An order without arguments, by its key."""
        self._order(name)

    def action_command(self, text: str) -> None:
        self._open_line(Purpose.COMMAND, text)

    def action_filter(self) -> None:
        """`/` on the log's screen, where the footer shows it."""
        self.action_look_for()

    def action_look_for(self) -> None:
        self.action_go("log")
        self._open_line(Purpose.FILTER, self._chosen.log_words)

    def action_unmark(self) -> None:
        """Unmark all agents; in the log: drop the filter."""
        if isinstance(self.pane, LogPane):
            self._choose(log_words="", log_level=Level.WELL)
        else:
            self._choose(marked=frozenset())

    def on_input_changed(self, event: Input.Changed) -> None:
        """The filter works while it is typed."""
        if self.query_one(CommandInput).purpose is Purpose.FILTER:
            self._choose(log_words=event.value)
        else:
            self._draw_below()

    def _submit(self, line: CommandInput) -> None:
        purpose, text = line.purpose, line.value.strip()
        self._close_line()
        if purpose is Purpose.FILTER:
            self._choose(log_words=text)
        elif text:
            line.remember(text)
            self.typed(text)

    def typed(self, text: str) -> None:
        self._order(text)

    def _open_line(self, purpose: Purpose, text: str) -> None:
        line = self.query_one(CommandInput)
        self.query_one("#prompt", Label).update(purpose.value[0])
        line.open(purpose, text)
        self._show_bottom()
        self._draw_below()

    def _close_line(self) -> None:
        self.query_one(CommandInput).close()
        self._show_bottom()
        self._draw_below()

    def _show_bottom(self) -> None:
        """The question, or the open line, or the keys."""
        asks, types = self._question is not None, self.query_one(CommandInput).purpose is not None
        self.query_one("#question").display = asks
        self.query_one("#entry").display = types and not asks
        self.query_one("#keys").display = not (asks or types)

    def _order(self, text: str) -> None:
        try:
            order = parse(text, self._plan, self._chosen.marked)
        except InputError as error:
            self._say(str(error))
            return
        self._notice = ""
        view = self._view
        if order.kind == CommandKind.NEXT and view is not None:
            order = replace(order, at_step=view.step_of(order.named(self._plan, view.step)))
        if words := consequence(order, self._plan, view):
            give = partial(self._give, order)
            dropped = f"{order.kind}: not sent; only Enter sends it"
            self._ask(Ask(words, "Enter sends it, Esc drops it.", give, dropped))
        else:
            self._give(order)

    def _ask(self, question: Ask) -> None:
        """Put the question in the place of the footer. What is typed before it was drawn is no
        answer; from then on it says what the keys do."""
        self._question, self._question_seen = question, False
        self._show_bottom()
        self._draw_below()
        self.call_after_refresh(self._see_question)

    def _see_question(self) -> None:
        self._question_seen = True
        self._draw_below()

    def _answer(self, yes: bool) -> None:
        question = self._question
        if question is None or (yes and not self._question_seen):
            return
        self._question = None
        self._show_bottom()
        if yes:
            question.do()
        else:
            self._say(question.otherwise)

    def _say(self, text: str, for_s: float = _NOTICE_WALL_S) -> None:
        """A word to the operator, until the next one."""
        self._notice = text
        self._draw_below()
        if self._unsay_timer is not None:
            self._unsay_timer.stop()
        self._unsay_timer = self.set_timer(for_s, self._unsay) if for_s < math.inf else None

    def _unsay(self) -> None:
        self._notice = ""
        self._draw_below()
