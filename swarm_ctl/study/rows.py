"""A study's result: a CSV file with one row a mission, in order, or a folder of Parquet files; and
beside it the study as JSON.

Numbers read back as the very same. Blocks are written whole and once, so that a study that was
interrupted goes on with those that are missing.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
from pydantic import ValidationError

from swarm_ctl.core.kernel.law import STATUSES
from swarm_ctl.errors import InputError
from swarm_ctl.files import named
from swarm_ctl.runfolder.files import write_whole
from swarm_ctl.study import parquet_parts
from swarm_ctl.study.batch.batch import Batch, blocks
from swarm_ctl.study.batch.batch_flight import BatchResult
from swarm_ctl.study.parameter_space import AGENT_RANGES, LISTS, MODEL, RANGES, Cell, Study

Row: TypeAlias = dict[str, Any]

_MEASURED: Final = tuple(f.name for f in fields(BatchResult) if f.name != "statuses")
_TEXT: Final = frozenset(
    {"shape", "slots", "start", "compensation", "vehicle", "safety", "spread", "wood"}
)


def rows_of(batch: Batch, result: BatchResult) -> list[Row]:
    """The rows of a flown batch (`row_columns.MEANINGS`)."""
    cell, count = batch.cell, len(batch)
    columns: dict[str, Any] = {"row": batch.row, "cell": np.full(count, cell.index)}
    columns |= {name: [_word(value)] * count for name, value in _listed(cell).items()}
    columns |= {name: getattr(batch, name) for name in (*RANGES, "wind_from_rad")}
    columns |= {f"least_{name}": columns[name].min(axis=0) for name in AGENT_RANGES}
    columns |= {f"most_{name}": columns[name].max(axis=0) for name in AGENT_RANGES}
    columns |= {name: getattr(result, name) for name in _MEASURED}
    columns["collided"] = result.smallest < cell.law.r_in
    columns["entered"] = result.smallest_zone < 0.0
    columns["hit"] = result.smallest_silent < cell.law.r_in
    columns = {WITH_UNIT.get(name, name): column for name, column in columns.items()}
    columns |= {f"sigma_{name}": result.statuses[k] for k, name in enumerate(STATUSES)}
    plain = [_plain(columns[name]) for name in COLUMNS]
    return [dict(zip(COLUMNS, values, strict=True)) for values in zip(*plain, strict=True)]


def _listed(cell: Cell) -> dict[str, Any]:
    """What the cell takes of each list; of the model, what is believed."""
    model = {name: getattr(cell.model, name.removeprefix("model_")) for name in MODEL}
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


class RowsFile(Protocol):
    """Takes the rows of a study's blocks, in any order."""

    @property
    def missing(self) -> Sequence[int]:
        """The numbers of the blocks that were not there at the beginning."""

    def add(self, block: int, rows: list[Row]) -> None:
        """Write the rows of one block."""


class _CsvFile:
    """A block that comes before its turn waits for those before it."""

    def __init__(self, path: Path, study: Study) -> None:
        self._path = path
        self._next = _whole_blocks(path, study) if path.exists() else 0
        if not path.exists() or not path.stat().st_size:
            with named(path):
                path.write_text(",".join(COLUMNS) + "\n")
        self.missing = range(self._next, len(blocks(study)))
        self._early: dict[int, list[Row]] = {}

    def add(self, block: int, rows: list[Row]) -> None:
        self._early[block] = rows
        with named(self._path), self._path.open("a") as file:
            while self._next in self._early:
                file.write(to_csv(self._early.pop(self._next)))
                self._next += 1


class _ParquetFolder:
    def __init__(self, path: Path, study: Study) -> None:
        self._path = path
        path.mkdir(exist_ok=True)
        there = set(parquet_parts.parts(path))
        self.missing = [k for k in range(len(blocks(study))) if k not in there]

    def add(self, block: int, rows: list[Row]) -> None:
        with named(self._path):
            parquet_parts.write_part(self._path, block, rows)


def has_rows(path: Path, study: Study) -> bool:
    """Whether rows of the study are at `path`; InputError where they are another study's."""
    if not (path.is_dir() or (path.exists() and path.stat().st_size)):
        return False
    if study_of(path) != study:
        raise InputError(
            f"{path} has the rows of another study (see {_about(path)}); choose another --out"
        )
    return True


def rows_file(path: Path, study: Study) -> RowsFile:
    """The file for the study's rows, by its suffix; what is there of it stays.

    InputError where it holds another study's rows.
    """
    if not has_rows(path, study):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(_about(path), study.model_dump_json(indent=1) + "\n")
    return _ParquetFolder(path, study) if _is_parquet(path) else _CsvFile(path, study)


def _is_parquet(path: Path) -> bool:
    return path.suffix == parquet_parts.SUFFIX


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
    os.truncate(path, sum(map(len, lines[: whole + 1])))  # the whole rows are not written again
    return done


def read_rows(path: Path) -> Iterator[Row]:
    """The rows in a file, numbers as numbers. InputError where it is not a study's."""
    if _is_parquet(path):
        _check_columns(path, parquet_parts.columns(path))
        yield from parquet_parts.read_parts(path)
        return
    try:
        with path.open(newline="") as file:
            reader = csv.DictReader(file)
            _check_columns(path, tuple(reader.fieldnames or ()))
            for row in reader:
                yield _typed(row)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


def _check_columns(path: Path, found: tuple[str, ...] | None) -> None:
    if found != COLUMNS:
        raise InputError(f"{path}: its columns are not those of a study of this version")


def _typed(row: Mapping[str, str]) -> Row:
    return {name: text if name in _TEXT else _number(text) for name, text in row.items()}


def _number(text: str) -> int | float:
    return int(text) if text.lstrip("-").isdigit() else float(text)


WITH_UNIT: Final = {
    "kappa": "kappa_per_s",
    "loss": "loss_share",
    "area": "area_units",
    "spacing": "spacing_units",
    "silent": "silent_share",
    "smallest": "smallest_units",
    "smallest_silent": "smallest_silent_units",
    "error": "error_units",
    "longest_link": "longest_link_units",
    "touched": "touched_share",
    "smallest_zone": "smallest_zone_units",
    "trunk": "trunk_units",
    "gap": "gap_units",
}
"""Columns whose names say more than the fields of `Study`, `Batch` and `BatchResult` do."""

_RESULTS: Final = {
    "collided": "1: two live agents came under `r_in`, at a tick or between two.",
    "smallest_units": "Smallest true distance of two live agents, between ticks too: each flies"
    " straight from one to the next.",
    "smallest_silent_units": "Smallest true distance of a live agent to the vehicle of a silent"
    " one; `inf` where no agent died. Two silent vehicles do not count.",
    "hit": "1: a live agent came under `r_in` of a silent vehicle.",
    "converged": "1: the formation of the live agents stood for `settle_s`.",
    "time_s": "When the formation stood, before settling; the end of the mission where it did not.",
    "error_units": "Largest |e_i - mean e| of the live agents at the end.",
    "links": "Links at the start: pairs within `r`.",
    "links_broken": "Of those, the ones that ever got longer than `r`.",
    "kept_broken": "Of those, the ones between live agents while their slots were within 0.9 `r`.",
    "longest_link_units": "The longest that one of the links ever was.",
    "stuck": "1: not formed at the end, all commands within 0.05 m/s of their mean for 20 s.",
    "touched_share": "Share of the live agents' ticks in which the safety filter changed the wish.",
    "yielded": "Agents' ticks in which keep-outs excluded each other.",
    "exchanges": "Slot exchanges.",
    "parted": "1: at a look (every 5 ticks) the links within `r` did not connect all agents.",
    "small_gap": "Pairs' ticks with `D_ub - D_lb <= 2`, which the paper takes for impossible.",
    "steps": "Ticks flown.",
    "entered": "1: a live agent was in a zone (a trunk), by truth.",
    "smallest_zone_units": "Smallest true distance of a live agent to a zone, between ticks too,"
    " under 0 inside; `inf` without a zone.",
    "over_shortest": "`time_s` over the time in which the file could be there: all at the top speed"
    " from the first moment on, one behind the other. 0 without a wood.",
}


def _of_parameters() -> dict[str, str]:
    said = {name: Study.model_fields[name].description or "" for name in (*LISTS, *RANGES)}
    told = said | {
        name: said[name].replace("None: ", "Not given: ") for name in said if "model" in name
    }
    alike = [name for name in (*LISTS, *RANGES) if name not in AGENT_RANGES]
    columns = {WITH_UNIT.get(name, name): told[name] for name in alike}
    for name in AGENT_RANGES:
        for end in ("least", "most"):
            columns[f"{end}_{name}"] = f"The {end} of the mission's agents. {said[name]}"
    return columns


MEANINGS: Final[dict[str, str]] = {
    "row": "Number of the mission in the study, from 0.",
    "cell": "Number of the combination of the lists' values, from 0.",
    **_of_parameters(),
    "silent_agents": "How many agents died.",
    "wind_from_rad": "Where the wind comes from, clockwise from north.",
    **_RESULTS,
    **{f"sigma_{name}": f"Pairs' ticks with the sigma status `{name}`." for name in STATUSES},
}
"""By column, in order."""
COLUMNS: Final = tuple(MEANINGS)
