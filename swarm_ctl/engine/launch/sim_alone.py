"""Runs the simulator alone in the foreground, until Ctrl-C."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from swarm_ctl.engine.clock import pause
from swarm_ctl.engine.interrupts import Interrupts
from swarm_ctl.errors import InputError, StartError

_POLL_WALL_S: Final = 0.05


def serve(settings: dict[str, Any], ready: Callable[[], None]) -> None:
    """Simulate until Ctrl-C or SIGTERM; calls `ready` once the vehicles listen.

    Raises:
        InputError: the simulator refuses its settings; its reason stands on stderr.
        StartError: a port or file does not open.
    """
    with tempfile.TemporaryDirectory() as folder, Interrupts() as ctrl_c:
        path = Path(folder) / "sim.json"
        path.write_text(json.dumps(settings))
        command = [sys.executable, "-m", "swarm_sim", "--config", str(path)]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            process_group=0,  # a terminal's Ctrl-C is for this process, which passes it on
        ) as child:
            if child.stdout is not None and child.stdout.readline():
                ready()
            passed_on = 0
            while (code := child.poll()) is None:
                if ctrl_c.count > passed_on:
                    passed_on = ctrl_c.count
                    child.terminate()  # once a signal: it still has to finish its truth file
                pause(_POLL_WALL_S)
    if code != 0 and not ctrl_c.count:
        error = InputError if code == 2 else StartError
        raise error(f"the simulator ended with code {code}; its reason stands above")
