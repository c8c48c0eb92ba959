"""The terminal that commands print to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from swarm_ctl.core.model.text import printable

_LINE: Final = 100_000
"""Lines are not shortened: 250 agents fill long ones."""


class PlainConsole(Console):
    """Prints text as it is: brackets and colons mean nothing, and control characters from a file or
    a message can't command the terminal."""

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
                lines = (printable(line, _LINE) for line in segment.text.split("\n"))
                yield Segment("\n".join(lines), segment.style)

    def say(self, text: str, style: str | None = None) -> None:
        """Print lines that the terminal wraps, so that a path can be copied whole."""
        self.print(text, style=style, soft_wrap=True)
