"""Reading and writing files of a run folder that a killed process may have torn."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from pydantic import BaseModel, ValidationError

from swarm_ctl.core.model.text import escaped
from swarm_ctl.errors import InputError

_SHOWN: Final = 5


@dataclass(slots=True)
class Damage:
    """What could not be read of a file of lines."""

    bad_lines: int = 0
    torn: bool = False
    """The last line has no end: its writer was killed."""

    def describe(self, name: str) -> list[str]:
        """The damage in words; empty where there is none."""
        many = "s" if self.bad_lines > 1 else ""
        bad = f"{name}: {self.bad_lines} line{many} could not be read"
        return [bad] * bool(self.bad_lines) + [f"{name}: the last line is torn"] * self.torn


def read_lines(path: Path, damage: Damage) -> Iterator[bytes]:
    """The lines of a file but for a torn last one, which `damage` notes. OSError passes."""
    with path.open("rb") as file:
        for line in file:
            if not line.endswith(b"\n"):
                damage.torn = True
            elif line.strip():
                yield line


def write_whole(path: Path, text: str) -> None:
    """Replace a file in one move, so that no reader finds a part of it; its permissions stay."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        part.write_text(text, encoding="utf-8", newline="")
        if path.exists():
            shutil.copymode(path, part)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from None


_Model = TypeVar("_Model", bound=BaseModel)


def write_model(path: Path, model: BaseModel) -> Path:
    """Write a JSON file, whole or not at all; its path."""
    write_whole(path, model.model_dump_json(indent=2) + "\n")
    return path


def read_model(path: Path, kind: type[_Model]) -> _Model:
    """Read what `write_model` wrote; InputError where it is missing, torn or not of this kind."""
    try:
        return kind.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {explained(error)}") from error


def explained(error: ValidationError) -> str:
    """The first few of pydantic's errors on one line."""
    return first_few(
        escaped(f"{'.'.join(map(str, found['loc'])) or 'document'}: {found['msg']}")
        for found in error.errors()
    )


def first_few(sentences: Iterable[str]) -> str:
    """The first five of some sentences, and how many more there are."""
    said = list(sentences)
    more = [f"and {len(said) - _SHOWN} more"] if len(said) > _SHOWN else []
    return "; ".join([*said[:_SHOWN], *more])
