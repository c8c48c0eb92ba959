"""A ground station: hears the mesh, folds it into the model, records it, passes an operator's
orders on."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.messages import Ack, AgentStatus, Command, Event, StationBeacon
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.recording import Recorder as McapRecorder
from swarm_ctl.report.folder.manifest import Manifest
from swarm_ctl.runtime.clock import Clock
from swarm_ctl.runtime.station.commander import Commander
from swarm_ctl.runtime.station.composing import compose
from swarm_ctl.runtime.station.mesh_clock import HeardClock
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import StationHealth, SwarmView

_ONLY_SHOWN: Final[tuple[keys.Channel[Any], ...]] = (keys.STATE, keys.SIGMA, keys.BEACON)
_BEACON_S: Final = 0.25
"""Twenty before an agent gives it up (5 s): with half of all messages lost one flight in 1,000;
with ten, one in 5."""
_STATUS_S: Final = 2.0
"""Mission time between recorded statuses of one agent: the fallback when it can't write its own
last one."""


class _Lines:
    """A file that grows by whole JSON lines; a disk that takes no more ends it, not the station."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("ab", buffering=0)
        self.name = path.name
        self.failure = ""

    def write(self, data: bytes) -> None:
        """One line."""
        if self.failure:
            return
        try:
            if self._file.write(data + b"\n") <= len(data):
                self.failure = os.strerror(errno.ENOSPC)
        except OSError as error:
            self.failure = error.strerror or str(error)

    def close(self) -> None:
        """No more lines."""
        self._file.close()


class Recorder:
    """Events, commands (with their answers) and statuses as JSON lines in the run folder, each line
    written at once.

    `mcap` takes everything. `station` is whose echoes the recording has.
    """

    def __init__(self, folder: Path, manifest: Manifest, station: str = "") -> None:
        about = {
            "mission": manifest.mission,
            "plan_hash": manifest.plan_hash,
            "manifest": manifest.model_dump_json(),
            "station": station,
        }
        start_ns = round(manifest.started_at.timestamp() * 1e9)
        self.mcap = McapRecorder(folder, start_ns, about, manifest.record_hz)
        self._events = _Lines(folder / "events.jsonl")
        self._commands = _Lines(folder / "commands.jsonl")
        self._statuses = _Lines(folder / "statuses.jsonl")
        self._told: set[str] = set()
        self._adapter = TypeAdapter(object)
        self._due: dict[int, float] = {}

    def event(self, event: Event) -> None:
        """Record an event."""
        self._events.write(self._adapter.dump_json(event))

    def command(self, command: Command | Ack) -> None:
        """Record a command or an answer to one."""
        self._commands.write(self._adapter.dump_json(command))

    def status(self, status: AgentStatus) -> None:
        """Record a status now and then, and always an agent's last one."""
        if status.outcome != "running" or status.time_s >= self._due.get(status.agent, 0.0):
            self._due[status.agent] = status.time_s + _STATUS_S
            self._statuses.write(self._adapter.dump_json(status))

    def troubles(self) -> list[str]:
        """What is not recorded any more, and why: each file once."""
        files = {
            lines.name: lines.failure for lines in (self._events, self._commands, self._statuses)
        }
        files["recording.mcap"] = self.mcap.failure
        new = {name: why for name, why in files.items() if why and name not in self._told}
        self._told |= new.keys()
        return [
            f"{name} is not written any more: {why}; the flight goes on"
            for name, why in new.items()
        ]

    def close(self) -> None:
        """Close the files."""
        self._events.close()
        self._commands.close()
        self._statuses.close()
        self.mcap.close()


class Station:
    """One ground station on one mesh; `name` is its node's, `mission` the file that has the
    shapes."""

    def __init__(
        self,
        plan: Plan,
        mission: Path,
        node: Node,
        clock: Clock | HeardClock,
        name: str,
        recorder: Recorder | None = None,
    ) -> None:
        self._plan = plan
        self._clock = clock
        self._node = node
        self._recorder = recorder
        self._hash = plan.hash()
        self._name = name
        self.model = self._new_model()
        agents = [agent.id for agent in plan.agents]
        self._commander = Commander(lambda command: node.send(keys.COMMAND, command), agents)
        self._beacon_due = 0.0
        self._mission = mission
        self._noted: set[str] = set()
        node.listen(
            keys.STATE, keys.STATUS, keys.SIGMA, keys.EVENT, keys.ACK, keys.BEACON, keys.COMMAND
        )

    def _new_model(self) -> Model:
        clock = self._clock
        return Model(self._plan, speedup=clock.speedup, since_s=clock.now(), station=self._name)

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

    def turn(self) -> list[str]:
        """Hear what there is to hear, say what is due; what the operator is to be told."""
        if isinstance(self._clock, HeardClock) and not self._heard(self._clock):
            return []
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
            self._commander.answered(ack)
            if self._recorder:
                self._recorder.command(ack)
        followed, told = self._commander.turn(now)
        for command in followed:
            self._note(command, now)
        if now >= self._beacon_due:
            self._beacon_due = now + _BEACON_S
            self._node.send(keys.BEACON, StationBeacon(self._name, now, self._hash))
        return told + (self._recorder.troubles() if self._recorder else [])

    def _heard(self, clock: HeardClock) -> bool:
        """Set the clock by what agents say. The first words only do that: their times mean nothing
        before."""
        known = clock.heard
        states = self._node.take(keys.STATE)
        for state, _ in states:
            clock.hear(state.time_s)
        for status, _ in self._node.take(keys.STATUS) if not known else ():
            clock.hear(status.time_s)
        if known:
            for state, received_s in states:
                self._fold(state, received_s)
        elif clock.heard:
            self.model = self._new_model()
        return known

    def view(self) -> SwarmView:
        """The picture now."""
        view = self.model.view(self._clock.now())
        return replace(view, health=StationHealth(self._node.bad_payloads))

    def _fold(self, payload: Any, received_s: float) -> None:
        self.model.fold(payload, received_s)
        if self._recorder:
            self._recorder.mcap.take(payload, received_s)
