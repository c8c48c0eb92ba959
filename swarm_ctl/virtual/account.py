"""What a flight on the virtual clock leaves: the truth, and all that a ground station hears; judged
as `run` judges a folder. With a folder it leaves all that `run` leaves, for report and replay."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from swarm_ctl.core.model.messages import AgentStatus, Event, Outcome, Payload
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.station.recorders import run_mcap
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.report.judge.summarise import summarise, summary_of
from swarm_ctl.report.judge.summary import Summary, write_summary
from swarm_ctl.runfolder.files import Damage
from swarm_ctl.runfolder.last_statuses import FINAL, last_statuses, of_processes, shifted
from swarm_ctl.runfolder.manifest import Manifest, package_versions, write_manifest
from swarm_ctl.runfolder.refused_orders import RefusedOrder, write_refused
from swarm_ctl.runfolder.run_folder import RunFolder, flown, zone_spells
from swarm_ctl.runfolder.tracks import ONE_CLOCK_S
from swarm_ctl.runfolder.truth import TRUTH, Truth, truth_line, truth_of
from swarm_sim.config import SimConfig
from swarm_sim.world.truth_recorder import TruthFile, TruthRecorder
from swarm_sim.world.world import World

_SWARM: Final = "virtual"
_HEARD: Final[tuple[keys.Channel[Any], ...]] = (
    keys.STATE,
    keys.SIGMA,
    keys.STATUS,
    keys.EVENT,
    keys.COMMAND,
    keys.ACK,
    keys.BEACON,
)
_STATE: Final = f"/{keys.STATE.name}"
_KILLED: Final = -9
"""The exit code of a process that was killed, as its parent has it."""


class _Trace:
    """A digest that goes on in copies of a flight, each for itself."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def update(self, data: bytes) -> None:
        """Take this in."""
        self._hash.update(data)

    def hexdigest(self) -> str:
        """Of all so far."""
        return self._hash.hexdigest()

    def __deepcopy__(self, _: object) -> _Trace:
        other = _Trace()
        other._hash = self._hash.copy()
        return other


class Account:
    """Of one flight. `folder`: made, and filled like a run's; None: nothing is written."""

    def __init__(
        self, mission: LoadedMission, config: SimConfig, folder: Path | None = None
    ) -> None:
        self._folder = folder
        self.manifest = _manifest(mission, whole=folder is not None)
        self._config = config
        self._lines: list[dict[str, Any]] = []
        self.statuses: list[AgentStatus] = []
        self.finals: dict[int, AgentStatus] = {}
        self._behind_s: dict[int, float] = {}
        """The station's clock less the agent's, by its newest word in a step that went on: one that
        is set after that does not move when the step ended."""
        self.events: list[Event] = []
        self.states: list[bytes] = []
        """Each state of an agent, encoded as on the mesh."""
        self._trace = _Trace()
        self._node: Node | None = None
        self._recorder: RunRecorder | None = None
        self._truth_file: TruthFile | None = None
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            write_manifest(folder, self.manifest)
            self._truth_file = TruthFile(folder / TRUTH)
            self._recorder = RunRecorder(folder, run_mcap(folder, self.manifest, "virtual"))

    def watch(self, world: World, mesh: MemoryHub) -> TruthRecorder:
        """Begin: what writes the truth of this world, step by step; the mesh is listened to."""
        mesh.tap = self._pass
        if self._recorder is not None:
            self._node = Node(MemoryTransport(mesh), "test", "account")
            agents = [agent.id for agent in self.manifest.plan.agents]
            self._node.listen(*_HEARD, agents=agents)
        return TruthRecorder(world, self._config, self)

    # --- the truth, as its recorder writes it ---

    def write(self, line: dict[str, Any]) -> None:
        """A line of the truth."""
        self._lines.append(line)
        self._trace.update(repr(line).encode())
        if self._truth_file is not None:
            self._truth_file.write(line)

    def close(self) -> None:
        """After its last line."""
        if self._truth_file is not None:
            self._truth_file.close()

    # --- what is heard ---

    def _pass(self, key: str, data: bytes) -> None:
        self._trace.update(key.encode())
        self._trace.update(data)
        if key.endswith(_STATE):
            self.states.append(data)

    def told(self, index: int, data: bytes) -> None:
        """What the agent at this place of the plan sends its vehicle."""
        self._trace.update(b"%d " % index)
        self._trace.update(data)

    def hear(self, statuses: list[AgentStatus], events: list[Event], now: float) -> None:
        """What the station took in a tick."""
        self.statuses += statuses
        for status in statuses:
            behind_s = now - status.time_s
            known_s = self._behind_s.setdefault(status.agent, behind_s)
            flies = not status.steps or status.steps[-1].end_s is None
            self._behind_s[status.agent] = behind_s if flies else known_s
        self.events += events
        if self._node is not None:
            for channel in _HEARD:
                for payload, _ in self._node.take(channel):
                    self.sent(payload, now)

    def sent(self, payload: Payload, now: float) -> None:
        """What the station itself said, or was said to it: it goes into the folder."""
        if self._recorder is not None:
            self._recorder.take(payload, now)

    def ended(self, agent: int, status: AgentStatus) -> None:
        """An agent's own last word."""
        self.finals[agent] = status
        if self._folder is not None:
            (self._folder / FINAL).mkdir(exist_ok=True)
            data = TypeAdapter(AgentStatus).dump_json(self._by_one_clock(status), indent=1)
            (self._folder / FINAL / f"{agent}.json").write_bytes(data)

    def _by_one_clock(self, status: AgentStatus) -> AgentStatus:
        """An agent's last word by the station's clock, as a station records it."""
        behind_s = self._behind_s.get(status.agent, 0.0)
        return shifted(status, behind_s) if abs(behind_s) > ONE_CLOCK_S else status

    def judge(
        self, killed: Mapping[str, bool], refused: Sequence[RefusedOrder] = ()
    ) -> tuple[Summary, Truth]:
        """The flight's summary and truth, once that is closed. `killed`: all processes that a run
        would have had, and whether this one was killed; `refused`: the scenario's orders that had
        to be accepted, and were not."""
        codes = {name: _KILLED if dead else 0 for name, dead in killed.items()}
        for agent, status in self.finals.items():
            if not killed[f"agent-{agent}"]:
                good = status.outcome in (Outcome.COMPLETED, Outcome.ABORTED)
                codes[f"agent-{agent}"] = 0 if good else 1
        truth = truth_of(map(truth_line, self._lines), Damage())
        if self._folder is not None:
            if self._recorder is not None:
                self._recorder.close()
            for each in refused:
                write_refused(self._folder, each)
            summary = summarise(self._folder, codes)
            write_summary(self._folder, summary)
        else:
            run = self._run(killed, truth)
            summary = summary_of(run, self.events, (), codes, refused=refused)
        self._trace.update(f"{summary.outcome} {summary.cause} {summary.reason}".encode())
        return summary, truth

    def digest(self) -> str:
        """Of every message of the mesh and to the vehicles, the truth and the verdict, in
        hexadecimal."""
        return self._trace.hexdigest()

    def _run(self, killed: Mapping[str, bool], truth: Truth) -> RunFolder:
        notes = list[str]()
        plan = self.manifest.plan
        ids = tuple(agent.id for agent in plan.agents)
        dead = {agent for agent in ids if killed[f"agent-{agent}"]}
        last = last_statuses(ids, of_processes(self.statuses), self._final_of(notes), notes, dead)
        flight = flown(truth, {}, self.manifest, last)
        return RunFolder(
            manifest=self.manifest,
            truth=truth,
            tracks={},
            flight=flight,
            agents=ids,
            last=last,
            notes=notes,
            zones=zone_spells(plan, (*self.statuses, *self.finals.values())),
        )

    def _final_of(self, notes: list[str]) -> Any:
        def final_of(agent: int) -> AgentStatus | None:
            found = self.finals.get(agent)
            if found is None:
                notes.append(f"agent {agent}: it left no account of its end")
            return found and self._by_one_clock(found)

        return final_of


def _manifest(mission: LoadedMission, *, whole: bool) -> Manifest:
    plan, fleet = mission.plan, mission.fleet
    started = wall.date_and_time()
    return Manifest(
        plan=plan,
        plan_hash=plan.fingerprint(),
        fleet=fleet.agents,
        mission=str(mission.source),
        swarm=_SWARM,
        started_at=started if whole else started.min.replace(year=1970, tzinfo=started.tzinfo),
        speedup=1.0,
        epoch_s=0.0,
        lockstep=_SWARM,
        headless=True,
        versions=package_versions() if whole else {},
    )
