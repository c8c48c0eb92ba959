"""Flies the blocks of a study on all cores. Rows come back in order: the file is the same for any
number of processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from swarm_ctl.study.batch.batch import Batch, blocks, draw
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.parameter_space import Cell, Study
from swarm_ctl.study.rows import Row, begin, rows_of, to_csv


def run_study(study: Study, path: Path, processes: int | None, console: Console) -> None:
    """Fly what is missing of a study and append it to the rows at `path`.

    Ctrl-C leaves whole blocks behind, says so, and is raised again.
    """
    done = begin(path, study)
    work = blocks(study)
    flown = sum(count for _, _, count in work[:done])
    columns = (TextColumn("missions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with path.open("a") as file, Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("missions", total=study.rows, completed=flown)
        try:
            for rows in _flown(work[done:], processes):
                file.write(to_csv(rows))
                file.flush()
                flown += len(rows)
                progress.advance(task, len(rows))
        except KeyboardInterrupt:
            progress.print(
                f"{path}: {flown} of {study.rows} missions; the same command goes on from here"
            )
            raise


def _flown(work: list[tuple[Cell, int, int]], processes: int | None) -> Iterator[list[Row]]:
    workers = min(processes or os.cpu_count() or 1, len(work))
    if workers <= 1:
        yield from map(_block, work)
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(workers, initializer=_quiet) as pool:
        yield from pool.imap(_block, work)


def _quiet() -> None:
    """The parent alone answers Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _block(block: tuple[Cell, int, int]) -> list[Row]:
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
