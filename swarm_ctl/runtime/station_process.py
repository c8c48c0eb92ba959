"""The ground station's process: hears the mesh, folds it into the model, shows it, records it, passes commands on.

`python -m swarm_ctl.runtime.station_process --run FOLDER` is how `run` starts it. Its stdin takes JSON lines
(`{"command": "land"}`, `{"finish": true}`); its end means that `run` is gone: then the station waits until all agents
have ended and the simulator has closed its book, and writes the summary itself.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from swarm_ctl.core.state import Ack, AgentStatus, Command, Event, StationBeacon
from swarm_ctl.errors import InputError, SwarmError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.recording import Recorder as McapRecorder
from swarm_ctl.report.manifest import Manifest, read_manifest
from swarm_ctl.report.summarise import summarise
from swarm_ctl.report.summary import write_summary
from swarm_ctl.runtime import clock as wall
from swarm_ctl.runtime.clock import Clock
from swarm_ctl.runtime.composing import compose
from swarm_ctl.runtime.control import ControlPipe
from swarm_ctl.runtime.screens import Blind, Screen, Show, metrics_on, present
from swarm_ctl.station.model import Model
from swarm_ctl.station.orders import Order
from swarm_ctl.station.view import AgentView, StationHealth, SwarmView

_ONLY_SHOWN: Final[tuple[keys.Channel[Any], ...]] = (keys.STATE, keys.SIGMA, keys.BEACON)
_BEACON_S = 0.5
_STATUS_S = 2.0
"""Mission time between recorded statuses of one agent: the fallback when it can't write its own last one."""
_COMMAND_S = 0.5
_LOOP_WALL_S = 0.05
_SHOW_WALL_S = 0.25
_SILENT_S = 15.0
"""An agent not heard for this long (mission time) has ended for an orphaned station: longer than any pause of a live
one (it gives its vehicle up after 10 s)."""
_BOOK_S = 100.0
"""How long an orphaned station waits for the simulator (it waits 90 s for the last vehicle to stand)."""


def station_name() -> str:
    """Of this process's station, on the mesh."""
    return f"station-{os.getpid()}"


class Recorder:
    """Events, commands (with their answers) and statuses as JSON lines in the run folder, each line written at once.

    `mcap` takes everything.
    """

    def __init__(self, folder: Path, manifest: Manifest) -> None:
        about = {
            "mission": manifest.mission,
            "plan_hash": manifest.plan_hash,
            "manifest": manifest.model_dump_json(),
            "station": station_name(),
        }
        start_ns = round(manifest.started_at.timestamp() * 1e9)
        self.mcap = McapRecorder(folder, start_ns, about, manifest.record_hz)
        self._events = (folder / "events.jsonl").open("ab", buffering=0)
        self._commands = (folder / "commands.jsonl").open("ab", buffering=0)
        self._statuses = (folder / "statuses.jsonl").open("ab", buffering=0)
        self._adapter = TypeAdapter(object)
        self._due: dict[int, float] = {}

    def event(self, event: Event) -> None:
        """Record an event."""
        self._events.write(self._adapter.dump_json(event) + b"\n")

    def command(self, command: Command | Ack) -> None:
        """Record a command or an answer to one."""
        self._commands.write(self._adapter.dump_json(command) + b"\n")

    def status(self, status: AgentStatus) -> None:
        """Record a status now and then, and always an agent's last one."""
        if status.outcome != "running" or status.time_s >= self._due.get(status.agent, 0.0):
            self._due[status.agent] = status.time_s + _STATUS_S
            self._statuses.write(self._adapter.dump_json(status) + b"\n")

    def close(self) -> None:
        """Close the files."""
        self._events.close()
        self._commands.close()
        self._statuses.close()
        self.mcap.close()


class Commander:
    """Sends commands until every agent has answered (or has been asked for long enough)."""

    def __init__(self, node: Node, agents: list[int]) -> None:
        self._node = node
        self._agents = agents
        self._open: dict[str, tuple[Command, set[int], float]] = {}
        self._due = 0.0

    def give(self, command: Command, now: float) -> None:
        """Send a command to the agents it is meant for."""
        self._open[command.id] = (command, set(command.agents or self._agents), now)
        self._due = now

    def answered(self, command: str, agent: int) -> None:
        """An acknowledgement came."""
        if command in self._open:
            self._open[command][1].discard(agent)

    def repeat(self, now: float) -> None:
        """Send what is not answered yet again; give up after 10 s."""
        if now < self._due:
            return
        self._due = now + _COMMAND_S
        for key, (command, missing, since) in list(self._open.items()):
            if not missing or now - since > 10.0:
                del self._open[key]
            else:
                self._node.send(keys.COMMAND, command)


class Station:
    """One ground station on one mesh."""

    def __init__(self, manifest: Manifest, node: Node, clock: Clock, recorder: Recorder | None) -> None:
        plan = manifest.plan
        self._clock = clock
        self._node = node
        self._recorder = recorder
        self._hash = plan.hash()
        self._name = station_name()
        self.model = Model(plan, speedup=manifest.speedup, since_s=clock.now(), station=self._name)
        self._commander = Commander(node, [agent.id for agent in plan.agents])
        self._beacon_due = 0.0
        self._mission = Path(manifest.mission)
        self._noted: set[str] = set()
        node.listen(keys.STATE, keys.STATUS, keys.SIGMA, keys.EVENT, keys.ACK, keys.BEACON, keys.COMMAND)

    def command(self, order: Order) -> None:
        """Pass an operator's order on; InputError where it can't be made a command."""
        now = self._clock.now()
        command = compose(order, self.model.view(now), self._mission)
        self._commander.give(command, now)
        self._note(command, now)

    def _note(self, command: Command, received_s: float) -> None:
        """Show and record a command once: ours, and those of other stations (`swarm-ctl send`)."""
        if command.id in self._noted:
            return
        self._noted.add(command.id)
        self._fold(command, received_s)
        if self._recorder:
            self._recorder.command(command)

    def turn(self) -> None:
        """Hear what there is to hear, say what is due."""
        now = self._clock.now()
        for channel in _ONLY_SHOWN:
            for payload, received_s in self._node.take(channel):
                self._fold(payload, received_s)
        for status, received_s in self._node.take(keys.STATUS):
            self._fold(status, received_s)
            if self._recorder:
                self._recorder.status(status)
        for event, received_s in self._node.take(keys.EVENT):
            self._fold(event, received_s)
            if self._recorder:
                self._recorder.event(event)
        for command, received_s in self._node.take(keys.COMMAND):
            self._note(command, received_s)
        for ack, received_s in self._node.take(keys.ACK):
            self._fold(ack, received_s)
            self._commander.answered(ack.command, ack.agent)
            if self._recorder:
                self._recorder.command(ack)
        self._commander.repeat(now)
        if now >= self._beacon_due:
            self._beacon_due = now + _BEACON_S
            self._node.send(keys.BEACON, StationBeacon(self._name, now, self._hash))

    def view(self) -> SwarmView:
        """The picture now."""
        view = self.model.view(self._clock.now())
        return replace(view, health=StationHealth(self._node.bad_payloads))

    def _fold(self, payload: Any, received_s: float) -> None:
        self.model.fold(payload, received_s)
        if self._recorder:
            self._recorder.mcap.take(payload, received_s)


def run_station(
    folder: Path, control: ControlPipe | None, say: Callable[[str], None], show: Show, metrics_port: int | None = None
) -> int:
    """Watch the run in `folder` until told to finish; 0 when all went as it should."""
    manifest = read_manifest(folder)
    clock = Clock(manifest.epoch_s, manifest.speedup)
    listen = [manifest.station_mesh] if manifest.station_mesh and control else []
    connect = [agent.mesh for agent in manifest.fleet if agent.mesh]
    node = Node(ZenohTransport(listen, connect, clock.now, clock.speedup), manifest.swarm, station_name())
    recorder = Recorder(folder, manifest) if control else None
    try:
        station = Station(manifest, node, clock, recorder)
        interrupt = _interrupt_of(control) if control else None
        with metrics_on(metrics_port) as measured:
            say("ready")
            orphan = Orphan(clock, folder)
            present(show, manifest.plan, interrupt, lambda screen: _watch(station, control, measured(screen), orphan))
    finally:
        node.close()
        if recorder:
            recorder.close()
    if control is not None and control.closed:
        write_summary(folder, summarise(folder, None))
    return 0


def _interrupt_of(control: ControlPipe) -> Callable[[], None]:
    """Ctrl-C in a terminal that gives it to us as a key: `run` gets the signal that it would have got."""

    def interrupt() -> None:
        if not control.closed:
            os.kill(os.getppid(), signal.SIGINT)

    return interrupt


def _watch(station: Station, control: ControlPipe | None, screen: Screen, orphan: Orphan) -> None:
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
        station.turn()
        if wall.wall_s() >= show_due:
            show_due = wall.wall_s() + _SHOW_WALL_S
            view = station.view()
            try:
                screen.show(view)
            except OSError:  # the terminal is gone; the flight and the record go on
                screen = Blind()
            if control is not None and control.closed and orphan.may_go(view):
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
    """When a station whose `run` was killed may end: all agents have, and the simulator's book is closed."""

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
    """Entry of `python -m swarm_ctl.runtime.station_process`."""
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
        return run_station(arguments.run, ControlPipe(sys.stdin.fileno()), say, arguments.show, arguments.metrics)
    except SwarmError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
