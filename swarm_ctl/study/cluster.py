"""Flies the blocks of a study on a Dask cluster.

What is flown where, when, and again after a worker was lost, is Dask's; each block's rows come back
once.
"""

from __future__ import annotations

import hashlib
import importlib.resources
import json
import logging
import platform
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from distributed import Client, KilledWorker, LocalCluster, as_completed

from swarm_ctl.cores import cores
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.installed import version
from swarm_ctl.signals import deaf_children, deaf_tracker, hears

Task = TypeVar("Task")
Result = TypeVar("Result")

LOCAL: Final = "local"
_LOOPBACK: Final = "127.0.0.1"
_ANSWERS_S: Final = 10.0


def on_cluster(
    scheduler: str, workers: int | None, function: Callable[[Task], Result], tasks: dict[int, Task]
) -> Iterator[tuple[int, Result]]:
    """`function` of each task, with the task's number, in the order in which they end.

    Args:
        scheduler: its address, a scheduler file (.json), or `local`: a cluster of this machine.
        workers: processes of a local cluster; None: one per core.
        function: has to be importable where the workers are.
        tasks: by number.

    Raises:
        InputError: no scheduler answers, or a worker has other code than this process.
        StartError: the scheduler is gone, or a task ended several workers.
    """
    with _client(scheduler, workers) as client:
        futures = client.map(
            _checked, list(tasks.values()), function=function, code=code_hash(), pure=False
        )
        numbers = {future.key: number for number, future in zip(tasks, futures, strict=True)}
        done = as_completed(futures, with_results=True)
        del futures  # rows are forgotten by the cluster once they are here
        try:
            for future, result in done:
                if isinstance(result, CancelledError):
                    raise StartError(f"--cluster {scheduler}: the scheduler is gone")
                yield numbers[future.key], result
        except KilledWorker as error:
            raise StartError(f"--cluster {scheduler}: {error}") from None
        except (GeneratorExit, KeyboardInterrupt, SystemExit):
            # broken off: Dask's loop would tell each result that is still on its way by a traceback
            logging.getLogger("tornado.application").setLevel(logging.CRITICAL)
            raise


def _checked(task: Task, function: Callable[[Task], Result], code: str) -> Result:
    if code != code_hash():
        raise InputError(
            f"the worker on {platform.node()} has other code (swarm_ctl"
            f" {version()}, numpy {np.__version__}); allowed: the same everywhere, or"
            " rows would differ"
        )
    return function(task)


@cache
def code_hash() -> str:
    """Of all that rows depend on: this project's code and numpy's version."""
    digest = hashlib.sha256(np.__version__.encode())
    for package in ("swarm_ctl", "swarm_sim"):
        folder = Path(str(importlib.resources.files(package)))
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return digest.hexdigest()


@contextmanager
def _client(scheduler: str, workers: int | None) -> Iterator[Client]:
    if scheduler == LOCAL:
        count = workers or cores()
        deaf_tracker()
        with deaf_children():
            local = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                host=_LOOPBACK,
                dashboard_address=f"{_LOOPBACK}:0",
                silence_logs=logging.ERROR,
            )
        with local as cluster, Client(cluster) as client:
            client.register_worker_callbacks(_heed_the_cluster)
            yield client
        return
    try:
        # a client waits for a scheduler file that is not there: read it here
        file = Path(scheduler)
        address = json.loads(file.read_text())["address"] if file.suffix == ".json" else scheduler
        client = Client(address, timeout=_ANSWERS_S)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"--cluster {scheduler}: no scheduler answers ({error}); allowed: local, an address"
            " like tcp://127.0.0.1:8786, or a scheduler file (.json)"
        ) from None
    with client:
        yield client


def _heed_the_cluster() -> None:
    """It ends its workers by this; the last word of one that has lost it is no news."""
    hears(signal.SIGTERM)
    logging.getLogger("distributed.worker").setLevel(logging.CRITICAL)
