"""The ground station's process: hears the mesh, folds it into the model, shows it, records it,
passes commands on.

`python -m swarm_ctl.runtime.station.station_process --run FOLDER` is how `run` starts it. Its stdin
takes JSON lines (`{"command": "land"}`, `{"finish": true}`); its end means that `run` is gone: then
the station waits until all agents have ended and the simulator has closed its book, and writes the
summary itself.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import signal
import sys
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from swarm_ctl.commands.parse import Order
from swarm_ctl.errors import InputError, SwarmError
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.report.folder.manifest import read_manifest
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import write_summary
from swarm_ctl.runtime import clock as wall
from swarm_ctl.runtime.clock import Clock
from swarm_ctl.runtime.station.control_pipe import ControlPipe
from swarm_ctl.runtime.station.ground_station import Recorder, Station
from swarm_ctl.runtime.station.mesh_clock import HeardClock, endpoints
from swarm_ctl.runtime.station.screens import Screen, Show, metrics_on, present
from swarm_ctl.station.picture.view import AgentView, SwarmView

_LOOP_WALL_S = 0.05
_SHOW_WALL_S = 0.25
_QUIET_WALL_S = 5.0
_SILENT_S = 15.0
"""An agent not heard for this long (mission time) has ended for an orphaned station: longer than
any pause of a live one (it gives its vehicle up after 10 s)."""
_BOOK_S = 100.0
"""How long an orphaned station waits for the simulator (it waits 90 s for the last vehicle to
stand)."""


def run_station(
    folder: Path,
    control: ControlPipe | None,
    say: Callable[[str], None],
    show: Show,
    metrics_port: int | None = None,
) -> int:
    """Watch the run in `folder` until told to finish; 0 when all went as it should."""
    manifest = read_manifest(folder)
    clock = Clock(manifest.epoch_s, manifest.speedup)
    listen = [manifest.station_mesh] if manifest.station_mesh and control else []
    connect = manifest.agents_mesh if control else manifest.whole_mesh
    name = _name()
    node = Node(ZenohTransport(listen, connect, clock.now, clock.speedup), manifest.swarm, name)
    recorder = Recorder(folder, manifest, name) if control else None
    try:
        station = Station(manifest.plan, Path(manifest.mission), node, clock, name, recorder)
        interrupt = _interrupt_of(control) if control else None
        with metrics_on(metrics_port) as measured:
            say("ready")
            orphan = Orphan(clock, folder)
            present(
                show,
                manifest.plan,
                interrupt,
                lambda screen: _watch(station, control, measured(screen), orphan),
            )
    finally:
        node.close()
        if recorder:
            recorder.close()
    if control is not None and control.closed:
        write_summary(folder, summarise(folder, None))
    return 0


def join(
    mission: LoadedMission,
    mesh: Sequence[str],
    show: Show,
    speedup: float,
    metrics_port: int | None,
) -> int:
    """Watch and command a swarm that flies `mission`, wherever it is; waits until it is heard. Ends
    with its screen."""
    clock, connect, name = HeardClock(speedup), endpoints(mission, mesh), _name()
    node = Node(ZenohTransport([], connect, clock.now, speedup), mission.plan.name, name)
    hint = Hint(clock, connect)
    try:
        station = Station(mission.plan, mission.source, node, clock, name)
        with metrics_on(metrics_port) as measured:
            present(
                show,
                mission.plan,
                None,
                lambda screen: _watch(station, None, measured(screen), hint),
            )
    finally:
        node.close()
    return 0


def _name() -> str:
    """One that no station on another host has."""
    return f"station-{os.getpid()}-{uuid.uuid4().hex[:4]}"


class Hint:
    """What a station that hears nobody says."""

    def __init__(self, clock: HeardClock, connect: Sequence[str]) -> None:
        self._clock = clock
        self._where = ", ".join(connect)
        self._due = wall.wall_s() + _QUIET_WALL_S

    def words(self) -> list[str]:
        """Now and then while nobody is heard."""
        if self._clock.heard or wall.wall_s() < self._due:
            return []
        self._due = wall.wall_s() + 4 * _QUIET_WALL_S
        return [
            f"nobody is heard at {self._where}; does the swarm fly, and is this where it listens? Trying on"
        ]


def _interrupt_of(control: ControlPipe) -> Callable[[], None]:
    """Ctrl-C in a terminal that gives it to us as a key: `run` gets the signal that it would have
    got."""

    def interrupt() -> None:
        if not control.closed:
            os.kill(os.getppid(), signal.SIGINT)

    return interrupt


def _watch(
    station: Station, control: ControlPipe | None, screen: Screen, aside: Orphan | Hint
) -> None:
    show_due = 0.0
    while control is not None or not screen.left:
        for message in control.poll() if control else ():
            if message.get("finish"):
                station.turn()
                screen.show(station.view())
                return
            _obey(message, station, screen)
        if control is not None and control.closed:
            screen.close()
        for order in screen.orders():
            _order(order, station, screen)
        for text in (*station.turn(), *(aside.words() if isinstance(aside, Hint) else ())):
            screen.note(text)
        if wall.wall_s() >= show_due:
            show_due = wall.wall_s() + _SHOW_WALL_S
            view = station.view()
            screen.show(view)
            if (
                control is not None
                and control.closed
                and isinstance(aside, Orphan)
                and aside.may_go(view)
            ):
                return
        wall.pause(_LOOP_WALL_S)


def _obey(message: dict[str, Any], station: Station, screen: Screen) -> None:
    """What `run` says."""
    if isinstance(message.get("command"), str):
        _order(Order(message["command"]), station, screen)
    if isinstance(message.get("note"), str):
        screen.note(message["note"])


def _order(order: Order, station: Station, screen: Screen) -> None:
    """Pass it on, or say why not."""
    try:
        station.command(order)
    except InputError as error:
        screen.note(str(error))


class Orphan:
    """When a station whose `run` was killed may end: all agents have, and the simulator's book is
    closed."""

    def __init__(self, clock: Clock, folder: Path) -> None:
        self._clock = clock
        self._truth = folder / "truth.jsonl"
        self._accounts = folder / "agents"
        self._ended_s: float | None = None

    def may_go(self, view: SwarmView) -> bool:
        """Ask once per view."""
        now = self._clock.now()
        if not all(self._has_ended(agent, now) for agent in view.agents if agent.in_plan):
            return False
        if self._ended_s is None:
            self._ended_s = now
        return not self._truth.exists() or _is_closed(self._truth) or now - self._ended_s > _BOOK_S

    def _has_ended(self, agent: AgentView, now: float) -> bool:
        """It has written its account, or it will not any more."""
        heard_s = agent.status.time_s if agent.status else -math.inf
        return (self._accounts / f"{agent.id}.json").exists() or now - heard_s > _SILENT_S


def _is_closed(truth: Path) -> bool:
    """The simulator's last line stands in its book."""
    with truth.open("rb") as book:
        book.seek(max(0, book.seek(0, os.SEEK_END) - 200))
        return b'"type":"end"' in book.read().replace(b" ", b"")


def main() -> int:
    """Entry of `python -m swarm_ctl.runtime.station.station_process`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--show", type=Show, default=Show.DASHBOARD)
    parser.add_argument("--metrics", type=int)
    parser.add_argument("--words-fd", type=int, required=True)
    arguments = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # Ctrl-C is `run`'s to answer; its pipe tells us

    def say(text: str) -> None:
        with contextlib.suppress(OSError):
            os.write(arguments.words_fd, (json.dumps({"say": text}) + "\n").encode())

    try:
        return run_station(
            arguments.run, ControlPipe(sys.stdin.fileno()), say, arguments.show, arguments.metrics
        )
    except SwarmError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
