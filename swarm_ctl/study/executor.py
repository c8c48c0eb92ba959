"""Flies the blocks of a study, on all cores or on a cluster. The rows are the same wherever they
are flown."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.cores import cores
from swarm_ctl.law_loader import own_law_of
from swarm_ctl.signals import deaf_children, deaf_tracker, hears
from swarm_ctl.study.batch.batch import Batch, blocks, draw, flown_alike, joined
from swarm_ctl.study.batch.batch_flight import fly
from swarm_ctl.study.batch.compiled import available, interpreted, law_compiled, waits
from swarm_ctl.study.parameter_space import Cell, Study
from swarm_ctl.study.rows import Row, rows_file, rows_of

_Block: TypeAlias = tuple[Cell, int, int]
_PAIRS: Final = 400_000
"""Of agents that fly in one batch, at most ..."""
_SHARES: Final = 2
"""... but so many batches for each worker, so that all end at about the same time."""
_ELSEWHERE: Final = 64
"""Workers that a cluster is taken to have."""


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
    if missing:
        prepare(console, study.law)
    columns = (TextColumn("missions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("missions", total=study.rows, completed=flown)
        try:
            # closed before anything is said: an interrupt in `add` must not leave workers behind
            with closing(_flown(missing, processes, cluster)) as flown_now:
                for block, rows in flown_now:
                    file.add(block, rows)
                    progress.advance(task, len(rows))
        except (KeyboardInterrupt, SystemExit):  # the second is what the command makes of it
            left = _missions(work[block] for block in rows_file(path, study).missing)
            progress.print(
                f"{path}: {study.rows - left} of {study.rows} missions; the same command goes on"
                " from here"
            )
            raise


def prepare(console: Console, law: LawParameters | None = None) -> None:
    """Compile what flies missions, if that has not been done: once, for all processes. Says what
    takes its time, an own law too that is not compiled."""
    if not available():
        console.print(
            "numba is not installed: missions take a hundred times as long; faster with: pip"
            " install 'swarm-ctl\\[study]'"
        )
    elif waits():
        console.print("compiling the flight of missions, once after each change of it ...")
        ((cell, first, count),) = blocks(Study(n=2, missions=1, limit_s=1.0))
        fly(draw(cell, first, count))
    own = own_law_of(law) if law is not None else None
    if own is not None and interpreted(own):
        why = law_compiled(own).why
        console.print(
            f"law {own.name!r} is not compiled, so its missions take tens of times as long: {why}"
        )


def fly_studies(
    studies: Sequence[Study], processes: int | None, cluster: str | None = None
) -> Iterator[list[Row]]:
    """The rows of studies of one block each, in their order."""
    work = {k: block for k, study in enumerate(studies) for block in blocks(study)}
    rows = dict(_flown(work, processes, cluster))
    yield from (rows[k] for k in work)


def _missions(work: Iterable[_Block]) -> int:
    return sum(count for _, _, count in work)


def _flown(
    work: dict[int, _Block], processes: int | None, cluster: str | None
) -> Generator[tuple[int, list[Row]], None, None]:
    """The rows of each block, as they come."""
    workers = processes or cores()
    remote = cluster not in (None, "local")
    groups = dict(enumerate(_groups(work, _ELSEWHERE if remote else workers)))
    blocks_of = {k: tuple(work[block] for block in group) for k, group in groups.items()}
    for k, rows in _done(blocks_of, min(workers, len(groups)), cluster):
        yield from zip(groups[k], rows, strict=True)


def _groups(work: dict[int, _Block], workers: int) -> list[list[int]]:
    """Blocks that are flown as one batch: the more missions are in the air, the less a tick costs
    each. Rows do not depend on it."""
    pairs = {block: cell.n**2 * count for block, (cell, _, count) in work.items()}
    most = min(_PAIRS, sum(pairs.values()) // (_SHARES * workers))
    groups: list[list[int]] = []
    filling: dict[object, tuple[list[int], int]] = {}
    for block, (cell, _, _) in work.items():
        kind = flown_alike(cell)
        group, full = filling.get(kind, ([], 0))
        if not group or full + pairs[block] > most:
            group, full = [], 0
            groups.append(group)
        group.append(block)
        filling[kind] = group, full + pairs[block]
    return groups


def _done(
    groups: dict[int, tuple[_Block, ...]], workers: int, cluster: str | None
) -> Iterator[tuple[int, list[list[Row]]]]:
    if not groups:
        return
    if cluster is not None:
        from swarm_ctl.study.cluster import on_cluster

        yield from on_cluster(cluster, workers, _fly, groups)
    elif workers == 1:
        yield from ((k, _fly(group)) for k, group in groups.items())
    else:
        context = multiprocessing.get_context("spawn")
        deaf_tracker()
        with deaf_children():
            pool = context.Pool(workers, initializer=hears, initargs=(signal.SIGTERM,))
        with pool:  # ends its workers by SIGTERM
            yield from zip(groups, pool.imap(_fly, groups.values()), strict=True)


def _fly(group: tuple[_Block, ...]) -> list[list[Row]]:
    """The rows of each block of a group."""
    batches = [draw(*block) for block in group]
    result = fly(joined(batches))
    ends = np.cumsum([len(batch) for batch in batches]).tolist()
    return [
        rows_of(batch, result.only(slice(end - len(batch), end)))
        for batch, end in zip(batches, ends, strict=True)
    ]


def batch_of_row(study: Study, row: int) -> Batch:
    """The mission of one row, drawn as it was; a batch of one. IndexError where there is none."""
    for cell, first, count in blocks(study):
        start = cell.index * study.missions + first
        if start <= row < start + count:
            batch = draw(cell, first, count)
            return batch.only(batch.row == row)
    raise IndexError(f"row {row}: allowed: 0 to {study.rows - 1}")
