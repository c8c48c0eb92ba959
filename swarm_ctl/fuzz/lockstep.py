"""A drawn scenario as processes in lockstep: they have to leave the truth of the virtual clock,
byte for byte. So the keeper of lockstep, the processes and their sockets are looked at, too."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.virtual.as_processes import run_script
from swarm_ctl.virtual.scenario import Scenario, scenario_text
from swarm_ctl.virtual.scenario_flight import fly_scenario

_TRUTH: Final = "truth.jsonl"
_ENDS_WALL_S: Final = 900.0
"""Many times what eight agents take on a quiet machine."""
_PATIENCE_WALL_S: Final = 120.0
"""However busy the machine is, no process takes so long for a tick."""


def unlike_as_processes(scenario: Scenario, mission: LoadedMission) -> str:
    """What became otherwise, or ''. '' also where something in the scenario can't happen to
    processes, and where a flight reaches its bound, which processes do not have."""
    try:
        run_script(scenario, mission.plan)
    except InputError:
        return ""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        path = folder / "scenario.yaml"
        path.write_text(scenario_text(scenario), encoding="utf-8")
        virtual = fly_scenario(scenario, mission, folder / "virtual")
        if virtual.up:
            return ""
        said = _run(path)
        if said is None:
            return f"processes had not ended after {_ENDS_WALL_S:g} s"
        runs = [*(folder / "runs").glob("*")]
        if len(runs) != 1 or not (runs[0] / _TRUTH).exists():
            return f"processes left no truth: {said.strip()[-500:]}"
        lines, flown = (
            (each / _TRUTH).read_text(encoding="utf-8").splitlines()
            for each in (folder / "virtual", runs[0])
        )
    pairs = itertools.zip_longest(lines, flown, fillvalue="none")
    other = next((line for known, line in pairs if known != line), "")
    return f"truth is another one, first by this line: {other[:200]}" if other else ""


def _run(path: Path) -> str | None:
    """What `run` says of it; None: it did not end, and was killed."""
    command = [sys.executable, "-m", "swarm_ctl.cli.main", "run", str(path), "--headless"]
    with (path.parent / "said.txt").open("w+", encoding="utf-8") as said:
        running = subprocess.Popen(
            [*command, "--no-report", "--lockstep-patience", f"{_PATIENCE_WALL_S:g}"],
            cwd=path.parent,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            running.wait(_ENDS_WALL_S)
        except subprocess.TimeoutExpired:
            return None
        finally:
            if running.poll() is None:  # also where this process is ended meanwhile
                os.killpg(running.pid, signal.SIGKILL)
                running.wait()
        said.seek(0)
        return said.read()
