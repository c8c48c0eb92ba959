"""One question before something that can't be taken back."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen
from textual.widgets import Button, Label


class Ask(ModalScreen[bool]):
    """The question over the screen; only `y` and a click say yes."""

    CSS = """
    Ask { align: center middle; }
    #ask { width: auto; max-width: 90%; height: auto; padding: 1 2; }
    #ask { border: heavy $error; background: $surface; }
    #ask Horizontal { height: auto; width: auto; padding-top: 1; }
    #ask Button { margin-right: 2; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer(True)"),
        Binding("n,escape", "answer(False)"),
    ]

    def __init__(self, question: str) -> None:
        super().__init__()
        self._question = question

    def compose(self) -> ComposeResult:
        with Vertical(id="ask"):
            yield Label(self._question, markup=False)
            with Horizontal():
                yield Button("y  yes", id="yes", variant="error", compact=True)
                yield Button("n  no", id="no", compact=True)

    def on_mount(self) -> None:
        """No button has the keyboard."""
        self.set_focus(None)

    def on_button_pressed(self, event: Button.Pressed) -> None:
        self.dismiss(event.button.id == "yes")

    def action_answer(self, yes: bool) -> None:
        self.dismiss(yes)
