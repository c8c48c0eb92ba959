"""The line at the bottom: commands, the log's filter, a replay's time."""

from __future__ import annotations

from enum import Enum
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.events import Key
from textual.suggester import Suggester
from textual.widgets import Input

from swarm_ctl.commands.parse import complete
from swarm_ctl.core.model.plan import Plan


class Purpose(Enum):
    """What the line is open for: its prompt, and what it says while it is empty."""

    COMMAND = ":", "a command; tab completes, esc leaves"
    FILTER = "/", "words to look for"
    TIME = ": ", "a time: 83, 1:23, +10, -10, end; esc leaves"


class CommandInput(Input):
    """An `Input` that has the keyboard only while it is open: completion with tab, the lines before
    with up and down."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "complete", show=False),
        Binding("up", "recall(-1)", show=False),
        Binding("down", "recall(1)", show=False),
    ]

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._completion = _Completion(plan)
        super().__init__(id="line", compact=True, suggester=self._completion, select_on_focus=False)
        self.can_focus = False
        self._before: list[str] = []
        self._at = 0
        self.purpose: Purpose | None = None
        """None: not in use."""

    async def press(self, event: Key) -> None:
        """Take a key of the keyboard."""
        bindings = self._bindings.key_to_bindings.get(event.key)
        if bindings:
            await self.run_action(bindings[0].action)
        elif event.character and event.is_printable:
            self.insert_text_at_cursor(event.character)

    def open(self, purpose: Purpose, text: str) -> None:
        """Take the keyboard."""
        self.purpose = purpose
        self.suggester = self._completion if purpose is Purpose.COMMAND else None
        _, self.placeholder = purpose.value
        self.can_focus = True
        self._put(text)
        self._at = len(self._before)
        self.screen.set_focus(self, scroll_visible=False)

    def close(self) -> None:
        self.purpose = None
        self.can_focus = False
        self.screen.set_focus(None)

    def remember(self, text: str) -> None:
        """For `up`."""
        self._before = [*(line for line in self._before if line != text), text]

    def action_complete(self) -> None:
        """Take the first line that this one could become."""
        found = complete(self.value, self._plan)
        if self.purpose is Purpose.COMMAND and found:
            self._put(found[0])

    def action_recall(self, by: int) -> None:
        self._at = min(max(0, self._at + by), len(self._before))
        self._put(self._before[self._at] if self._at < len(self._before) else "")

    def _put(self, text: str) -> None:
        self.value = text
        self.cursor_position = len(text)


class _Completion(Suggester):
    def __init__(self, plan: Plan) -> None:
        super().__init__(use_cache=False)
        self._plan = plan

    async def get_suggestion(self, value: str) -> str | None:
        """The first line that `value` could become."""
        return next(iter(complete(value, self._plan)), None) if value else None
