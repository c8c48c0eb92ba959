"""A study on a Dask cluster: the same rows as on one process, whatever becomes of its workers."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from swarm_ctl.errors import InputError
from swarm_ctl.study import executor, parquet_parts
from swarm_ctl.study.batch import batch as batch_module
from swarm_ctl.study.batch.batch import blocks
from swarm_ctl.study.executor import run_study
from swarm_ctl.study.parameter_space import Cell, Range, Study
from swarm_ctl.study.rows import Row, read_rows

STUDY = Study(
    n=(3, 4),
    slots=("random",),
    delay_s=(Range(low=0.0, high=0.2),),
    loss=(Range(low=0.0, high=0.3),),
    missions=24,
    limit_s=2.0,
    seed=5,
)
_KILLED = "SWARM_CTL_TEST_KILLED"


def run(path: Path, processes: int, cluster: str | None = None) -> list[Row]:
    """Fly the study; its rows."""
    run_study(STUDY, path, processes, Console(file=io.StringIO()), cluster)
    return list(read_rows(path))


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several blocks out of few missions."""
    monkeypatch.setattr(batch_module, "block_size", lambda n: 8)


fly, block_size = executor._fly, batch_module.block_size


def kills_its_worker_once(group: tuple[tuple[Cell, int, int], ...]) -> list[list[Row]]:
    """Blocks of a study; the third of them ends its worker, the first time that it is flown."""
    killed = Path(os.environ[_KILLED])
    if any(first == 16 for _, first, _ in group) and not killed.exists():
        killed.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return fly(group)


@pytest.mark.realtime
def test_a_cluster_that_loses_a_worker_has_the_same_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on one process, byte for byte, each row once: one of two workers is killed in the middle
    of a block."""
    pytest.importorskip("distributed")
    run(tmp_path / "1.csv", 1)
    monkeypatch.setenv(_KILLED, str(tmp_path / "killed"))
    monkeypatch.setattr(executor, "_fly", kills_its_worker_once)
    run(tmp_path / "cluster.csv", 2, "local")
    assert (tmp_path / "killed").exists()
    one = (tmp_path / "1.csv").read_bytes()
    assert one.count(b"\n") == 1 + STUDY.rows
    assert (tmp_path / "cluster.csv").read_bytes() == one


def test_parquet_has_the_rows_of_the_csv_file(tmp_path: Path) -> None:
    """Also after some of its parts were lost: only those are flown again."""
    pytest.importorskip("pyarrow")
    rows = run(tmp_path / "rows.csv", 1)
    folder = tmp_path / "rows.parquet"
    assert run(folder, 1) == rows
    assert parquet_parts.parts(folder) == list(range(len(blocks(STUDY))))
    lost, *kept = sorted(folder.iterdir())
    lost.unlink()
    before = [path.stat().st_mtime_ns for path in kept]
    assert run(folder, 1) == rows
    assert [path.stat().st_mtime_ns for path in kept] == before


def test_a_csv_file_takes_blocks_in_any_order(tmp_path: Path) -> None:
    """They stand in the study's order."""
    from swarm_ctl.study.rows import rows_file

    want = run(tmp_path / "1.csv", 1)
    file, work = rows_file(tmp_path / "2.csv", STUDY), blocks(STUDY)
    for block in (1, 0, *reversed(range(2, len(work)))):
        file.add(block, *fly((work[block],)))
    assert list(read_rows(tmp_path / "2.csv")) == want


@pytest.mark.realtime
def test_ctrl_c_ends_a_local_cluster(tmp_path: Path) -> None:
    """A terminal sends it to the workers, too: no process is left, nothing but whole blocks is
    written, and the same command goes on."""
    pytest.importorskip("distributed")
    path = tmp_path / "rows.csv"
    command = [sys.executable, "-m", "swarm_ctl.cli.main", "study", "--cluster", "local"]
    command += ["--missions", "100000", "--n", "20", "--limit", "0.2"]
    command += ["--processes", "1", "--out", str(path)]
    study = subprocess.Popen(
        command, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        _wait(lambda: path.exists() and path.read_bytes().count(b"\n") > 1)
        os.killpg(study.pid, signal.SIGINT)
        output, _ = study.communicate(timeout=20)
    finally:
        if study.poll() is None:
            os.killpg(study.pid, signal.SIGKILL)
    assert study.returncode == 130
    assert "the same command goes on" in output.replace("\n", " ")
    assert "Traceback" not in output
    assert "WARNING" not in output
    _wait(lambda: not _alive(study.pid))
    assert (path.read_bytes().count(b"\n") - 1) % block_size(20) == 0


def _wait(done: Callable[[], bool], seconds: float = 150.0) -> None:
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end
        time.sleep(0.05)


def _alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("scheduler", ["nowhere", "none.json"])
def test_a_scheduler_that_is_not_there_is_named(tmp_path: Path, scheduler: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match=f"--cluster {scheduler}: no scheduler answers"):
        run(tmp_path / "rows.csv", 1, scheduler)


def test_a_worker_with_other_code_flies_nothing() -> None:
    pytest.importorskip("distributed")
    from swarm_ctl.study.cluster import _checked, code_hash

    assert _checked(4, abs, code_hash()) == 4
    with pytest.raises(InputError, match="has other code"):
        _checked(4, abs, "other")
