"""A drawn scenario as processes in lockstep: they have to leave the truth of the virtual clock,
byte for byte. So the keeper of lockstep, the processes and their sockets are looked at, too."""

from __future__ import annotations

import itertools
import os
import signal
import tempfile
from pathlib import Path
from typing import Final

from swarm_ctl.engine.launch.flight_process import FlightProcess, ProgramFlight
from swarm_ctl.engine.launch.run_setup import Lockstep, RunOptions
from swarm_ctl.engine.station.screens import Show
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import LoadedMission, dumps
from swarm_ctl.virtual.as_processes import run_script
from swarm_ctl.virtual.scenario import Scenario
from swarm_ctl.virtual.scenario_flight import fly_scenario

_TRUTH: Final = "truth.jsonl"
_ENDS_WALL_S: Final = 900.0
"""Many times what eight agents take on a quiet machine."""
_PATIENCE_WALL_S: Final = 120.0
"""However busy the machine is, no process takes so long for a tick."""
_LINES: Final = 20


def unlike_as_processes(scenario: Scenario, mission: LoadedMission) -> str:
    """What became otherwise, or ''. '' also where something in the scenario can't happen to
    processes, and where a flight reaches its bound, which processes do not have."""
    try:
        script = run_script(scenario, mission.plan)
    except InputError:
        return ""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        virtual = fly_scenario(scenario, mission, folder / "virtual")
        if virtual.up:
            return ""
        options = RunOptions(
            show=Show.LOG,
            runs=folder / "runs",
            seed=scenario.seed,
            lockstep=Lockstep(patience_wall_s=_PATIENCE_WALL_S),
            script=script,
        )
        named = str(mission.source)
        said = _flown(folder, ProgramFlight(dumps(mission.file), named, options, report=False))
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


def _flown(folder: Path, flight: ProgramFlight) -> str | None:
    """What its process said; None: it did not end, and was killed with its children."""
    running = FlightProcess(folder, flight, apart=True)
    try:
        return running.said(_LINES) if running.wait(_ENDS_WALL_S) else None
    finally:
        if not running.over:  # also where this process is ended meanwhile
            os.killpg(running.pid, signal.SIGKILL)
        running.kill()
