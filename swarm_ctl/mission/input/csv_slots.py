"""Replaces each shape of kind `csv` in a mission by the slots of its file.

A mission may come from a stranger: the file lies in the mission's folder or below, and no message
shows what is in it.
"""

from __future__ import annotations

import csv
import io
import math
import os
from pathlib import Path
from typing import Final

from swarm_ctl.files import read_bytes
from swarm_ctl.mission.input.document import Document

_MOST_BYTES: Final = 1_000_000
"""Of a file at most: a thousand slots take 50 kB."""
_WITH_HEIGHTS: Final = 3
"""Columns."""
_ALLOWED: Final = "a CSV file of at most 1 MB, in the mission's folder or below"


def graft(source: Document, folder: Path) -> bool:
    """Replace every shape of kind `csv` by one of kind `offsets`; paths are relative to `folder`.

    False if a file can't be read: a problem at the mission's line says why.
    """
    shapes = source.data.get("shapes") if isinstance(source.data, dict) else None
    if not isinstance(shapes, dict):
        return True
    before = len(source.problems)
    for name, shape in shapes.items():
        if not isinstance(shape, dict) or shape.get("kind") != "csv":
            continue
        rest = dict(shape)
        path = rest.pop("path", None)
        if not isinstance(path, str):
            continue
        try:
            rows = _read(folder, path)
            rest |= {"kind": "offsets", "offsets": tuple(row[:2] for row in rows)}
            if len(rows[0]) == _WITH_HEIGHTS:
                if "up_m" in rest:
                    raise _BadRowError(1, "has a third column, and the shape has up_m: one of them")
                rest["up_m"] = tuple(row[2] for row in rows)
        except _BadRowError as error:
            what = f"{folder / path}:{error.line}: {error}"
            allowed = (
                "two numbers a line: north, east; or three in each: north, east, up_m (the first"
                " line may have names)"
            )
        except (OSError, ValueError, csv.Error) as error:
            why = getattr(error, "strerror", None) or str(error)
            what, allowed = f"{folder / path} can't be read: {why}", _ALLOWED
        else:
            shapes[name] = rest
            continue
        source.problems.append(source.problem(("shapes", name, "path"), what, allowed))
    return len(source.problems) == before


class _BadRowError(ValueError):
    def __init__(self, line: int, text: str) -> None:
        super().__init__(text)
        self.line = line


def _read(folder: Path, name: str) -> list[tuple[float, ...]]:
    path = Path(os.path.realpath(folder / name))
    if not path.is_relative_to(os.path.realpath(folder)):
        raise ValueError("lies outside of the mission's folder")
    found: list[tuple[float, ...]] = []
    text = read_bytes(path, _MOST_BYTES).decode("utf-8-sig")
    head = text.lstrip().partition("\n")[0]
    for mark, between in ((";", "semicolons"), ("\t", "tabs")):
        if mark in head and (mark == ";" or "," not in head):
            raise _BadRowError(1, f"has {between} between its cells, not commas")
    rows = csv.reader(io.StringIO(text, newline=""))
    for row in rows:
        if not any(cell.strip() for cell in row):
            continue
        numbers = [_number(cell) for cell in row]
        known = tuple(number for number in numbers if number is not None)
        wide = len(found[0]) if found else len(row)
        if len(row) == len(known) == wide and wide in (2, _WITH_HEIGHTS):
            found.append(known)
        elif found or rows.line_num > 1 or any(number is not None for number in numbers):
            right = len(row) in (2, _WITH_HEIGHTS) and len(row) == wide
            why = "has a cell that is no number" if right else f"has {len(row)} cells"
            raise _BadRowError(rows.line_num, f"{why}: not a slot")
    if not found:
        raise _BadRowError(1, "no slot in it")
    return found


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
