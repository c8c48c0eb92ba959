"""The process of a run's own ground station.

`run` starts it as `python -m swarm_ctl.engine.station.station_process --run FOLDER`. Its stdin
takes JSON lines (`{"command": "land"}`, `{"note": "..."}`, `{"finish": true}`). The end of stdin
means that `run` is gone: then the station waits until all agents and the simulator have ended, and
writes the summary itself.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from swarm_ctl.engine.lockstep.seat import STATION, Seat, die, take_seat
from swarm_ctl.engine.lockstep.words import TickPhase
from swarm_ctl.engine.protection import operator_identity
from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.control_pipe import ControlPipe
from swarm_ctl.engine.station.ground_station import Station, open_node
from swarm_ctl.engine.station.recorders import run_mcap
from swarm_ctl.engine.station.screens import Screen, Show, present
from swarm_ctl.engine.station.scripted_operator import ScriptedOperator, script_of
from swarm_ctl.engine.station.station_loop import RunControl, loop
from swarm_ctl.engine.vehicle_memory import SwarmMemory, VehicleMemory, state_folder
from swarm_ctl.errors import SwarmError
from swarm_ctl.mesh.zenoh_config import part_in
from swarm_ctl.mission.compile.offers import pack
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import write_summary
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.station.picture.protection import protection


def run_station(
    folder: Path,
    pipe: ControlPipe,
    ready: Callable[[], None],
    show: Show,
    attach: Sequence[str] = (),
) -> None:
    """Watch, command and record the run in `folder` until `run` ends it; `attach`: extensions."""
    manifest = read_manifest(folder)
    listen = [manifest.station_mesh] if manifest.station_mesh else []
    identity = operator_identity(manifest.trust, manifest.flown_by)
    with contextlib.ExitStack() as opened:
        seat = take_seat(manifest.lockstep, TickPhase.SWARM, manifest.epoch_s, manifest.speedup)
        opened.callback(seat.close)
        clock = seat.clock
        node = open_node(
            manifest.swarm,
            manifest.agents_mesh,
            clock,
            listen=listen,
            seat=seat,
            identity=identity,
            part=part_in(manifest.plan, manifest.routers),
            plan=pack(manifest.plan, manifest.fleet, manifest.signing),
            own=manifest.zenoh,
        )
        opened.callback(node.close)
        endpoints = {agent.id: agent.endpoint for agent in manifest.fleet}
        station = Station(
            plan=manifest.plan,
            node=node,
            clock=clock,
            memory=SwarmMemory(VehicleMemory(state_folder()), folder.name, endpoints, folder),
            protection=protection(identity, manifest.signing, is_open=manifest.open_mesh),
        )
        attached = opened.enter_context(Attachments(attach, station))
        mcap = run_mcap(folder, manifest, station.name, attached.sinks)
        station.record(opened.enter_context(closing(RunRecorder(folder, mcap))))
        control = RunControl(pipe, seat, folder)
        seat.join(STATION, manifest.swarm, node.name)
        ready()
        present(
            show,
            manifest.plan,
            lambda: None if pipe.closed else os.kill(os.getppid(), signal.SIGINT),
            lambda screen: loop(
                station, screen, control, attached, seat.begin, _end(folder, seat, station, screen)
            ),
        )
    if pipe.closed:
        write_summary(folder, summarise(folder, None))


def _end(folder: Path, seat: Seat, station: Station, screen: Screen) -> Callable[[], None]:
    """What ends a tick; before that, in a scenario, its operator has his turn."""
    script = script_of(folder)
    if script is None:
        return seat.end
    operator = ScriptedOperator(script, station, screen.note)

    def end() -> None:
        if operator.turn(seat.clock.now()):
            die(seat)
        seat.end()

    return end


def main() -> int:
    """Entry of `python -m swarm_ctl.engine.station.station_process`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--show", type=Show, default=Show.DASHBOARD)
    parser.add_argument("--attach", action="append", default=[])
    parser.add_argument("--words-fd", type=int, required=True)
    arguments = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # `run` answers Ctrl-C, and tells us on the pipe

    def ready() -> None:
        with contextlib.suppress(OSError):
            os.write(arguments.words_fd, (json.dumps({"say": "ready"}) + "\n").encode())

    pipe = ControlPipe(sys.stdin.fileno())
    try:
        run_station(arguments.run, pipe, ready, arguments.show, arguments.attach)
    except SwarmError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
