"""Reading and writing files of a run folder that a killed process may have torn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from pydantic import BaseModel, ValidationError

from swarm_ctl.core.model.text import escaped
from swarm_ctl.errors import InputError
from swarm_ctl.files import open_regular, read_bytes, replacing

_SHOWN: Final = 5
_LINE_BYTES: Final = 1 << 20
"""Of one line at most: 25 times what 250 vehicles' states take."""
_MODEL_BYTES: Final = 32_000_000
"""Of a JSON file at most: the plan of the largest mission, and room."""


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
    """The lines of a file but for a torn last one and those that are too long, which `damage`
    notes. OSError passes."""
    with open_regular(path) as file:
        too_long = False
        while line := file.readline(_LINE_BYTES):
            if line.endswith(b"\n"):
                if line.strip() and not too_long:
                    yield line
                too_long = False
            elif len(line) < _LINE_BYTES:
                damage.torn = True
            elif not too_long:
                too_long = True
                damage.bad_lines += 1


def write_whole(path: Path, text: str) -> None:
    """Replace a file in one move, so that no reader finds a part of it; its permissions stay."""
    with replacing(path) as file:
        file.write(text.encode())


_Model = TypeVar("_Model", bound=BaseModel)


def write_model(path: Path, model: BaseModel) -> Path:
    """Write a JSON file, whole or not at all; its path."""
    write_whole(path, model.model_dump_json(indent=2) + "\n")
    return path


def read_model(path: Path, kind: type[_Model]) -> _Model:
    """Read what `write_model` wrote; InputError where it is missing, torn or not of this kind."""
    try:
        return kind.model_validate_json(read_bytes(path, _MODEL_BYTES))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {explained(error)}") from error


def explained(error: ValidationError) -> str:
    """The first few of pydantic's errors on one line; of a file of another version, that alone."""
    errors = error.errors()
    for found in errors:
        if found["loc"] == ("schema_version",) and found["type"] == "literal_error":
            return escaped(
                f"schema_version: {found['input']!r} is of another version of swarm-ctl; allowed:"
                f" {found['ctx']['expected']}, or the swarm-ctl that wrote it"
            )
    return first_few(
        escaped(f"{'.'.join(map(str, found['loc'])) or 'document'}: {found['msg']}")
        for found in errors
    )


def first_few(sentences: Iterable[str]) -> str:
    """The first five of some sentences, and how many more there are."""
    said = list(sentences)
    more = [f"and {len(said) - _SHOWN} more"] if len(said) > _SHOWN else []
    return "; ".join([*said[:_SHOWN], *more])
