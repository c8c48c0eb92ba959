"""What only shows never ends what keeps safe: the rim at which an error of a view, an alarm, a
recording or a bridge is caught, said and counted, while the flight goes on."""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
_CAUSE: Final = 200
"""Characters of an error's own words at most: they may have come from the mesh."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """What went wrong in a part that only shows."""

    part: str
    why: str
    off: bool
    """The part does nothing any more."""

    def __str__(self) -> str:
        how = "has stopped" if self.off else "failed"
        return f"{self.part} {how}: {self.why}; the flight goes on"


class Rim:
    """Runs one part that only shows. `part` is its name for an operator; after `most` errors in a
    row it is off and is not run any more (None: it is tried on and on). `home`: the package of its
    code.

    Any thread may use it, one at a time. `Exception` alone is caught, memory and recursion errors
    included: an interrupt or an exit passes.
    """

    def __init__(self, part: str, most: int | None = None, home: str = "swarm_ctl") -> None:
        self.part: Final = part
        self.count = 0
        """Errors so far."""
        self._most, self._home = most, home
        self._in_row = 0
        self._told: set[bool] = set()
        self._new: deque[Trouble] = deque()

    @property
    def off(self) -> bool:
        """The part is not run any more."""
        return self._most is not None and self._in_row >= self._most

    def run(self, call: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> T | None:
        """What the part returns; None where it failed, or is off."""
        if self.off:
            return None
        try:
            found = call(*args, **named)
        except Exception as error:
            self.note(error)
            return None
        self._in_row = 0
        return found

    def note(self, error: Exception) -> None:
        """Count an error that was caught elsewhere."""
        self.count += 1
        self._in_row += 1
        if self.off not in self._told:  # once that it failed, once that it is off
            self._told.add(self.off)
            self._new.append(Trouble(self.part, explained(error, self._home), self.off))

    def troubles(self) -> list[Trouble]:
        """What is new since the last call."""
        return [self._new.popleft() for _ in range(len(self._new))]


def explained(error: Exception, home: str = "swarm_ctl") -> str:
    """An error in a line: what it is, and where in the package `home` it came up."""
    words = " ".join(str(error).split())[:_CAUSE]
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    where = ""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if home in frame.filename:
            name = frame.filename.replace("\\", "/").rpartition("/")[2]
            where = f" ({name}:{frame.lineno})"
            break
    return f"{type(error).__name__}{': ' if words else ''}{words}{where}"
