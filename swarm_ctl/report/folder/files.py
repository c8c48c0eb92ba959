"""Small things about files that the run folder's readers and writers share."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import ValidationError

_SHOWN_PROBLEMS: Final = 5


@dataclass(slots=True)
class Damage:
    """What could not be read of a file of lines."""

    bad_lines: int = 0
    torn: bool = False
    """The last line has no end: its writer was killed."""

    def describe(self, name: str) -> list[str]:
        """The damage in words; empty where there is none."""
        lines = f"{self.bad_lines} line{'s' if self.bad_lines > 1 else ''} could not be read"
        return [f"{name}: {lines}"] * bool(self.bad_lines) + [
            f"{name}: the last line is torn"
        ] * self.torn


def read_lines(path: Path, damage: Damage) -> Iterator[bytes]:
    """The lines of a file, one after the other; a torn last one is told in `damage` and left out.
    OSError passes."""
    with path.open("rb") as file:
        for line in file:
            if not line.endswith(b"\n"):
                damage.torn = True
            elif line.strip():
                yield line


def write_whole(path: Path, text: str) -> None:
    """Replace a file in one move: a reader finds the old or the new one, never a part. Its rights
    stay."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        part.write_text(text, encoding="utf-8", newline="")
        if path.exists():
            shutil.copymode(path, part)
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def wording(error: ValidationError) -> str:
    """pydantic's complaints in one line, the first few of them."""
    problems = [
        f"{'.'.join(map(str, found['loc'])) or 'document'}: {found['msg']}"
        for found in error.errors()
    ]
    more = (
        [f"and {len(problems) - _SHOWN_PROBLEMS} more"] if len(problems) > _SHOWN_PROBLEMS else []
    )
    return "; ".join(problems[:_SHOWN_PROBLEMS] + more)
