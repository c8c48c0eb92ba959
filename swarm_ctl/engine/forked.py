"""The entry of each process that another one of ours starts, and the end of each that flies."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NoReturn

from swarm_ctl.engine.lifeline import PipeLifeline
from swarm_ctl.errors import SwarmError


def serve_forked(
    work: Callable[[Path, int, PipeLifeline], int],
    folder: Path,
    number: int,
    log: Path,
    connection: Connection,
) -> NoReturn:
    """`serve` in a process that `run` forks, which only its lifeline ends: it is told the run's
    folder and its number. `log`: where stdout and stderr go."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def logged(lifeline: PipeLifeline) -> int:
        _redirect(log)
        return work(folder, number, lifeline)

    serve(logged, connection.fileno(), connection.fileno())


def serve(work: Callable[[PipeLifeline], int], hears: int = 0, says: int = 1) -> NoReturn:
    """Do the process's `work`, then end the process with the exit code that it returns. What ends
    it otherwise is told to the parent, and stands in the log. By default stdin is the lifeline, and
    stdout is where the words go."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # the parent answers Ctrl-C
    lifeline = PipeLifeline(hears, says)
    try:
        code = work(lifeline)
    except SwarmError as error:
        sys.stderr.write(f"{error}\n")
        lifeline.tell(str(error))
        code = error.exit_code
    except BaseException:
        traceback.print_exc()
        lifeline.tell(traceback.format_exc(limit=-1).strip().splitlines()[-1])
        code = 70  # EX_SOFTWARE
    leave(code)


def leave(code: int) -> NoReturn:
    """End this process; all its links are closed. The interpreter is not taken down: an agent that
    had completed on a busy machine once ended with SIGABRT there, while zenoh's threads still ran,
    and systemd would have started it again. A forkserver's atexit is skipped, too."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _redirect(log: Path) -> None:
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o600)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
