"""The orders of a scenario that the swarm refused, as a run's folder has them: `refused.jsonl`, a
JSON object a line; no file: none was, or no scenario was flown."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, TypeAdapter, ValidationError

from swarm_ctl.core.model.text import printable
from swarm_ctl.files import append_line
from swarm_ctl.runfolder.files import Damage, read_lines

REFUSED: Final = "refused.jsonl"
_MOST: Final = 1000
"""As many as a scenario has happenings."""
_LONGEST: Final = 500
"""Characters of a reason."""


@dataclass(frozen=True, slots=True)
class RefusedOrder:
    """One of them, which had to be accepted."""

    time_s: Annotated[float, Field(allow_inf_nan=False)]
    """Mission time at which the scenario gives it."""
    order: str
    """As it is typed."""
    why: str
    """By whom it was refused, and why."""

    @property
    def text(self) -> str:
        """For the verdict."""
        return f"the scenario's order `{self.order}` at {self.time_s:g} s: {self.why}"


_READ: Final = TypeAdapter(RefusedOrder)


def write_refused(folder: Path, refused: RefusedOrder) -> None:
    """Add it to the folder's; an OSError names the file."""
    append_line(folder / REFUSED, json.dumps(asdict(refused)))


def read_refused(folder: Path, notes: list[str]) -> list[RefusedOrder]:
    """The folder's, the earliest first; a damaged file goes to `notes`."""
    found, damage = list[RefusedOrder](), Damage()
    if not (folder / REFUSED).exists():
        return found
    try:
        for line in read_lines(folder / REFUSED, damage):
            try:
                said = _READ.validate_json(line)
            except ValidationError:
                damage.bad_lines += 1
                continue
            words = (printable(text, _LONGEST) for text in (said.order, said.why))
            found.append(RefusedOrder(said.time_s, *words))
    except OSError as error:
        notes.append(f"{REFUSED}: {error.strerror}")
    notes += damage.describe(REFUSED)
    return in_order(found)[:_MOST]


def in_order(refused: Iterable[RefusedOrder]) -> list[RefusedOrder]:
    """The earliest first."""
    return sorted(refused, key=lambda each: (each.time_s, each.order))
