"""Flies the blocks of a study, on all cores or on a cluster. The rows are the same wherever they
are flown."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeAlias

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.parameter_space import Cell, Study
from swarm_ctl.study.rows import Row, rows_file, rows_of

_Block: TypeAlias = tuple[Cell, int, int]


def run_study(
    study: Study, path: Path, processes: int | None, console: Console, cluster: str | None = None
) -> None:
    """Fly what is missing of a study and add it to the rows at `path`.

    Ctrl-C leaves whole blocks behind, says so, and is raised again.

    Args:
        study: what to fly.
        path: a CSV file, or a folder of Parquet files (.parquet).
        processes: on this machine; None: one per core.
        console: for the progress.
        cluster: a Dask scheduler to fly it on instead, see `cluster.on_cluster`.
    """
    file, work = rows_file(path, study), blocks(study)
    missing = {block: work[block] for block in file.missing}
    flown = study.rows - _missions(missing.values())
    columns = (TextColumn("missions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("missions", total=study.rows, completed=flown)
        try:
            for block, rows in _flown(missing, processes, cluster):
                file.add(block, rows)
                progress.advance(task, len(rows))
        except KeyboardInterrupt:
            left = _missions(work[block] for block in rows_file(path, study).missing)
            progress.print(
                f"{path}: {study.rows - left} of {study.rows} missions; the same command goes on"
                " from here"
            )
            raise


def _missions(work: Iterable[_Block]) -> int:
    return sum(count for _, _, count in work)


def _flown(
    work: dict[int, _Block], processes: int | None, cluster: str | None
) -> Iterator[tuple[int, list[Row]]]:
    """The rows of each block, as they come."""
    if not work:
        return
    workers = min(processes or os.cpu_count() or 1, len(work))
    if cluster is not None:
        from swarm_ctl.study.cluster import on_cluster

        yield from on_cluster(cluster, workers, _block, work)
    elif workers == 1:
        yield from ((block, _block(work[block])) for block in work)
    else:
        context = multiprocessing.get_context("spawn")
        with context.Pool(workers, initializer=_quiet) as pool:
            yield from zip(work, pool.imap(_block, work.values()), strict=True)


def _quiet() -> None:
    """The parent alone answers Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _block(block: _Block) -> list[Row]:
    batch = draw(*block)
    return rows_of(batch, fly(batch))


def batch_of_row(study: Study, row: int) -> Batch:
    """The mission of one row, drawn as it was; a batch of one. IndexError where there is none."""
    for cell, first, count in blocks(study):
        start = cell.index * study.missions + first
        if start <= row < start + count:
            batch = draw(cell, first, count)
            return batch.only(batch.row == row)
    raise IndexError(f"row {row}: allowed: 0 to {study.rows - 1}")
