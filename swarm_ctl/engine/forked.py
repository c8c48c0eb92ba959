"""The entry of a process that `run` forks, and the end of each process that flies."""

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
    work: Callable[[PipeLifeline], int], log: Path | None, connection: Connection
) -> NoReturn:
    """Do the process's `work`, then end the process with the exit code that it returns. `log`:
    where stdout and stderr go; None: they stay."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # only the lifeline ends it
    lifeline = PipeLifeline(connection)
    try:
        if log is not None:
            _redirect(log)
        code = work(lifeline)
    except SwarmError as error:
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
