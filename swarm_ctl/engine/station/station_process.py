"""The process of a run's own ground station.

`run` starts it as `python -m swarm_ctl.engine.station.station_process FOLDER WORDS`; on the
descriptor WORDS it says that it works. Its stdin takes JSON lines (`{"command": "land"}`,
`{"note": "..."}`, `{"finish": true}`). The end of stdin means that `run` is gone: then the station
waits until all agents and the simulator have ended, and writes the summary itself.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from swarm_ctl.engine.launch_file import read_launch
from swarm_ctl.engine.lifeline import READY
from swarm_ctl.engine.lockstep.seat import STATION, take_seat
from swarm_ctl.engine.lockstep.words import TickPhase
from swarm_ctl.engine.protection import operator_identity
from swarm_ctl.engine.station.recorders import run_mcap
from swarm_ctl.engine.station.screens import Show
from swarm_ctl.engine.station.session import StationSession
from swarm_ctl.engine.station.station_loop import ControlPipe, RunControl
from swarm_ctl.engine.station.swarm_mesh import SwarmMesh
from swarm_ctl.engine.vehicle_memory import SwarmMemory, VehicleMemory, state_folder
from swarm_ctl.errors import SwarmError
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import write_summary
from swarm_ctl.runfolder.manifest import read_manifest


def run_station(folder: Path, pipe: ControlPipe, ready: Callable[[], None]) -> None:
    """Watch, command and record the run in `folder` until `run` ends it."""
    manifest, launch = read_manifest(folder), read_launch(folder)
    identity = operator_identity(manifest.trust, manifest.flown_by)
    seat = take_seat(manifest.lockstep, TickPhase.SWARM, manifest.epoch_s, manifest.speedup)
    mesh = replace(
        SwarmMesh.of_run(manifest, identity, seat=seat),
        connect=manifest.agents_mesh,
        listen=[manifest.station_mesh] if manifest.station_mesh else [],
    )
    memory = SwarmMemory(VehicleMemory(state_folder()), folder.name, mesh.endpoints, folder)
    with closing(seat), StationSession(mesh, launch.attach, memory) as session:
        name = session.station.name
        mcap = run_mcap(folder, manifest, name, session.attached.sinks)
        session.record(RunRecorder(folder, mcap))
        seat.join(STATION, manifest.swarm, name)
        ready()
        session.show(
            Show(launch.show),
            RunControl(pipe, seat, folder, launch.script.station if launch.script else None),
            lambda: None if pipe.closed else os.kill(os.getppid(), signal.SIGINT),
        )
    if pipe.closed:
        write_summary(folder, summarise(folder, None))


def main() -> int:
    """Entry of `python -m swarm_ctl.engine.station.station_process`."""
    folder, words = Path(sys.argv[1]), int(sys.argv[2])
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # `run` answers Ctrl-C, and tells us on the pipe

    def ready() -> None:
        with contextlib.suppress(OSError):
            os.write(words, f"{READY}\n".encode())

    pipe = ControlPipe(sys.stdin.fileno())
    try:
        run_station(folder, pipe, ready)
    except SwarmError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
