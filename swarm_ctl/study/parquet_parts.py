"""Rows as a folder of Parquet files, a part for each block of a study: parts may be written in any
order, and each appears whole or not at all. pandas, polars and DuckDB read the folder as one
table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

SUFFIX = ".parquet"


def parts(folder: Path) -> list[int]:
    """The numbers of the blocks that are there, in order."""
    return sorted(int(path.stem.removeprefix("part-")) for path in folder.glob(f"part-*{SUFFIX}"))


def write_part(folder: Path, block: int, rows: list[dict[str, Any]]) -> None:
    """Write the rows of one block."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    unfinished = folder / f".{block}.unfinished"
    pq.write_table(pa.Table.from_pylist(rows), unfinished)
    unfinished.replace(_part(folder, block))


def columns(folder: Path) -> tuple[str, ...] | None:
    """The names of the columns; None where there is no part yet."""
    import pyarrow.parquet as pq

    first = next(iter(parts(folder)), None)
    return None if first is None else tuple(pq.read_schema(_part(folder, first)).names)


def read_parts(folder: Path) -> Iterator[dict[str, Any]]:
    """All rows, in the order of their blocks."""
    import pyarrow.parquet as pq

    for block in parts(folder):
        yield from pq.ParquetFile(_part(folder, block)).read().to_pylist()


def _part(folder: Path, block: int) -> Path:
    return folder / f"part-{block:06d}{SUFFIX}"
