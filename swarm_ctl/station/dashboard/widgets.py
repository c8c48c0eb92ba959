"""Panels and bars: widgets that show lines drawn elsewhere, and redraw only those that changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, Final

from rich.style import Style
from textual.binding import Binding, BindingType
from textual.events import Key
from textual.geometry import Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.suggester import Suggester
from textual.widgets import Input

from swarm_ctl.commands.parse import complete
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.station.dashboard.styled_line import Line

_PLACEHOLDERS: Final = {
    "order": "a command; tab completes, esc leaves",
    "filter": "words to look for",
    "time": "a time: 83, 1:23, +10, -10, end; esc leaves",
}


class Painted(ScrollView, can_focus=False):
    """Lines under a scroll bar where they don't fit. `follows`: stays at the end while nobody
    scrolls up."""

    class Sized(Message):
        """There is another room to draw in."""

    def __init__(self, name: str, *, follows: bool = False) -> None:
        super().__init__(id=name)
        self._strips: list[Strip] = []
        self._follows = follows
        self._ground: Style | None = None

    @property
    def room(self) -> tuple[int, int]:
        """Width and height to draw in."""
        size = self.scrollable_content_region.size
        return size.width, size.height

    def paint(self, lines: Sequence[Line], back: str = "", width: int | None = None) -> None:
        """Show other lines, each cut or filled to the width (the widget's own where not given)."""
        own, height = self.room
        width = own if width is None else width
        strips = [Strip(line.fit(width, back), width) for line in lines]
        before, self._strips = self._strips, strips
        at_end = self.scroll_offset.y >= self.virtual_size.height - height - 1
        if len(strips) != len(before):
            self.virtual_size = Size(width, len(strips))
            self.refresh()
            if self._follows and at_end:
                self.scroll_end(animate=False, force=True)
            return
        for y, (old, new) in enumerate(zip(before, strips, strict=True)):
            if old != new:
                self.refresh_lines(y, 1)

    def on_resize(self) -> None:
        """What was drawn was for another room."""
        self.post_message(self.Sized())

    def render_line(self, y: int) -> Strip:
        """One row of the widget, on the theme's own colours."""
        k = y + self.scroll_offset.y
        width = self.scrollable_content_region.width
        if self._ground is None:
            self._ground = (
                self.rich_style
            )  # a tenth of all drawing, if it were looked up for each line
        strip = self._strips[k] if k < len(self._strips) else Strip.blank(width)
        return (
            strip if strip.cell_length == width else strip.adjust_cell_length(width)
        ).apply_style(self._ground)

    def notify_style_update(self) -> None:
        """Another theme, say."""
        self._ground = None
        super().notify_style_update()


class CommandInput(Input):
    """The command line (and the log's filter): completion with tab, the lines before with up and
    down."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "complete"),
        Binding("up", "recall(-1)"),
        Binding("down", "recall(1)"),
    ]

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._completion = _Completion(plan)
        super().__init__(id="line", compact=True, suggester=self._completion)
        self.can_focus = False
        self._before: list[str] = []
        self._at = 0
        self.purpose = ""
        """A key of `_PLACEHOLDERS`; empty: not in use."""

    async def _on_key(self, event: Key) -> None:
        """Editing keys act in their turn. As mere bindings they would be looked at after what was
        typed behind them: over a slow line, or pasted, `5`, backspace, `4` would come out as 5.
        """
        bindings = self._bindings.key_to_bindings.get(event.key)
        if not bindings:
            await super()._on_key(event)
            return
        event.stop()
        event.prevent_default()
        await self.run_action(bindings[0].action)

    def open(self, purpose: str, text: str) -> None:
        """Take the keyboard."""
        self.purpose = purpose
        self.suggester = self._completion if purpose == "order" else None
        self.placeholder = _PLACEHOLDERS[purpose]
        self.can_focus = True
        self.value = text
        self.cursor_position = len(text)
        self._at = len(self._before)
        self.screen.set_focus(
            self, scroll_visible=False
        )  # at once: the next key belongs to the line already

    def close(self) -> None:
        """Give it back."""
        self.purpose = ""
        self.can_focus = False
        self.screen.set_focus(None)

    def remember(self, text: str) -> None:
        """For `up`."""
        self._before = [*(line for line in self._before if line != text), text]

    def action_complete(self) -> None:
        """Take the first line that this one could become."""
        found = complete(self.value, self._plan)
        if self.purpose == "order" and found:
            self.value = found[0]
            self.cursor_position = len(found[0])

    def action_recall(self, by: int) -> None:
        """A line from before."""
        self._at = min(max(0, self._at + by), len(self._before))
        self.value = self._before[self._at] if self._at < len(self._before) else ""
        self.cursor_position = len(self.value)


class _Completion(Suggester):
    def __init__(self, plan: Plan) -> None:
        super().__init__(use_cache=False)
        self._plan = plan

    async def get_suggestion(self, value: str) -> str | None:
        """The first line that `value` could become."""
        return next(iter(complete(value, self._plan)), None) if value else None


Draw = Callable[[int, int], Sequence[Line]]
"""Lines for a width and a height."""
