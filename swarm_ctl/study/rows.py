"""A study's result: a CSV file with one row a mission, in order, and beside it the study as JSON.

Numbers read back as the very same. Whole blocks are appended, so that a study that was interrupted
goes on behind its last whole block.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from pydantic import ValidationError

from swarm_ctl.core.law.formation_law import STATUSES
from swarm_ctl.core.model.plan import Response
from swarm_ctl.errors import InputError
from swarm_ctl.study.batch.batch import Batch, blocks
from swarm_ctl.study.batch.batch_flight import BatchResult
from swarm_ctl.study.parameter_space import AGENT_RANGES, LISTS, RANGES, Cell, Study

Row: TypeAlias = dict[str, Any]

_MEASURED: Final = tuple(f.name for f in fields(BatchResult) if f.name != "statuses")
_RESULT: Final = ("collided", *_MEASURED[:2], "hit", *_MEASURED[2:])
COLUMNS: Final = (
    "row",
    "cell",
    *LISTS,
    *(name for name in RANGES if name not in AGENT_RANGES),
    *(f"{end}_{name}" for name in AGENT_RANGES for end in ("least", "most")),
    "wind_from_rad",
    *_RESULT,
    *(f"sigma_{name}" for name in STATUSES),
)
_TEXT: Final = frozenset({"shape", "slots", "start", "compensation", "vehicle", "safety", "spread"})


def rows_of(batch: Batch, result: BatchResult) -> list[Row]:
    """The rows of a flown batch. Lengths in units."""
    cell, count = batch.cell, len(batch)
    columns: dict[str, Any] = {"row": batch.row, "cell": np.full(count, cell.index)}
    columns |= {name: [_word(value)] * count for name, value in _listed(cell).items()}
    columns |= {name: getattr(batch, name) for name in (*RANGES, "wind_from_rad")}
    columns |= {f"least_{name}": columns[name].min(axis=0) for name in AGENT_RANGES}
    columns |= {f"most_{name}": columns[name].max(axis=0) for name in AGENT_RANGES}
    columns |= {name: getattr(result, name) for name in _MEASURED}
    columns["collided"] = result.smallest < cell.law.r_in
    columns["hit"] = result.smallest_silent < cell.law.r_in
    columns |= {f"sigma_{name}": result.statuses[k] for k, name in enumerate(STATUSES)}
    plain = [_plain(columns[name]) for name in COLUMNS]
    return [dict(zip(COLUMNS, values, strict=True)) for values in zip(*plain, strict=True)]


def _listed(cell: Cell) -> dict[str, Any]:
    """What the cell takes of each list; of the model, what is believed."""
    model = {f"model_{f.name}": getattr(cell.model, f.name) for f in fields(Response)}
    return {name: getattr(cell, name) for name in LISTS} | model


def _word(entry: float | str) -> float | str:
    return str(entry) if isinstance(entry, str) else entry


def _plain(column: Any) -> list[Any]:
    if not isinstance(column, np.ndarray):
        return list(column)
    return [int(v) for v in column] if column.dtype == np.bool_ else column.tolist()


def to_csv(rows: list[Row]) -> str:
    """Rows as CSV lines without a header."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(list(row.values()) for row in rows)
    return text.getvalue()


def study_of(path: Path) -> Study:
    """The study whose rows are at `path`; InputError where there is none."""
    about = _about(path)
    try:
        return Study.model_validate_json(about.read_bytes())
    except OSError as error:
        raise InputError(f"{about}: {error.strerror}; it belongs to the rows in {path}") from None
    except ValidationError as error:
        raise InputError(
            f"{about}: is not a study of this version: {error.errors()[0]['msg']}"
        ) from None


def begin(path: Path, study: Study) -> int:
    """Prepare `path` for the study's rows; how many blocks of it are there already.

    InputError where the file holds another study's rows.
    """
    if path.exists() and path.stat().st_size:
        if study_of(path) != study:
            raise InputError(
                f"{path} has the rows of another study (see {_about(path)}); choose another --out"
            )
        return _whole_blocks(path, study)
    path.parent.mkdir(parents=True, exist_ok=True)
    _about(path).write_text(study.model_dump_json(indent=1) + "\n")
    path.write_text(",".join(COLUMNS) + "\n")
    return 0


def _about(path: Path) -> Path:
    return path.with_suffix(path.suffix + ".json")


def _whole_blocks(path: Path, study: Study) -> int:
    """Cut the file behind its last whole block; how many blocks it has."""
    lines = path.read_bytes().splitlines(keepends=True)
    while lines and not lines[-1].endswith(b"\n"):
        lines.pop()
    done = whole = 0
    for _, _, count in blocks(study):
        if whole + count > len(lines) - 1:
            break
        whole += count
        done += 1
    path.write_bytes(b"".join(lines[: whole + 1]))
    return done


def read_rows(path: Path) -> Iterator[Row]:
    """The rows in a file, numbers as numbers. InputError where it is not a study's."""
    try:
        with path.open(newline="") as file:
            reader = csv.DictReader(file)
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise InputError(f"{path}: its columns are not those of a study of this version")
            for row in reader:
                yield _typed(row)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


def _typed(row: Mapping[str, str]) -> Row:
    return {name: text if name in _TEXT else _number(text) for name, text in row.items()}


def _number(text: str) -> int | float:
    return int(text) if text.lstrip("-").isdigit() else float(text)
