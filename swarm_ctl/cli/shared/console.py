"""The terminal that commands print to."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from swarm_ctl.core.model.text import escaped


class PlainConsole(Console):
    """Prints text as it is: brackets and colons mean nothing, and control characters of a file or a
    message become escapes such as `\\x1b`, which can't command the terminal."""

    def __init__(self, *, stderr: bool = False, **settings: Any) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False, **settings)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterator[Segment]:
        """All that is printed passes here: strings, texts, the cells of tables."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment("\n".join(map(escaped, segment.text.split("\n"))), segment.style)

    def on_broken_pipe(self) -> None:
        """The reader of our output has gone: nothing more is printed. rich would end this process,
        which may fly a swarm."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())  # what is still buffered
        os.close(nowhere)

    def warn(self, warnings: Iterable[str]) -> None:
        """Print what is allowed but worth a second look."""
        for warning in warnings:
            self.say(f"warning: {warning}", style="yellow")

    def say(self, text: str, style: str | None = None) -> None:
        """Print lines that the terminal wraps, so that a path can be copied whole."""
        self.print(text, style=style, soft_wrap=True)
