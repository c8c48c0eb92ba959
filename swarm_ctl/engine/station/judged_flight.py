"""The ground station of a flight whose agents were started elsewhere (containers, the drones' own
computers): it makes the run's folder, records, ends with the agents, and judges."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.messages import AgentState, AgentStatus, Outcome, Payload
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.flying_runs import make_folder
from swarm_ctl.engine.interrupts import Interrupts
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.join import Hint, SwarmElsewhere, open_elsewhere
from swarm_ctl.engine.station.recorders import run_mcap
from swarm_ctl.engine.station.screens import Screen, Show
from swarm_ctl.engine.station.station_loop import Control, give
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.files import replacing
from swarm_ctl.recording.mcap_recorder import McapRecorder, Sink
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary, write_summary
from swarm_ctl.report.judge.verdict import Ending
from swarm_ctl.rim import Rim, Trouble
from swarm_ctl.runfolder.files import Damage, read_lines
from swarm_ctl.runfolder.last_statuses import FINAL, shifted
from swarm_ctl.runfolder.manifest import Manifest, package_versions, write_manifest
from swarm_ctl.runfolder.truth import TRUTH, TruthHeader
from swarm_ctl.station.picture.view import AgentView

_SILENT_S: Final = 60.0
"""Mission time after which a silent agent does not keep the station waiting any more: longer than a
link that comes back is gone, and than a landing without one takes."""
_STATUS: Final = TypeAdapter(AgentStatus)


@dataclass(frozen=True, slots=True)
class JudgedRun:
    """How the flight ended. `interrupts`: how often Ctrl-C was pressed."""

    folder: Path
    summary: Summary
    interrupts: int


def judge_swarm(
    swarm: SwarmElsewhere,
    runs: Path,
    show: Show,
    attach: Sequence[str],
    alive: Callable[[], None],
    interrupts: Interrupts,
    truth: Path | None = None,
) -> JudgedRun | None:
    """Watch, command and record the swarm until its agents have ended; Ctrl-C lands it. None where
    Ctrl-C came before an agent was heard.

    Args:
        swarm: its mission, and where it is on the mesh.
        runs: where the run's folder is made.
        show: the kind of screen.
        attach: extensions, each `NAME[=ARGUMENT]`.
        alive: called each turn.
        interrupts: entered; counts Ctrl-C.
        truth: what a simulator on this computer writes of the vehicles.
    """
    with (
        open_elsewhere(swarm, attach) as session,
        closing(_Flight(swarm, runs, interrupts, alive, session.attached.sinks, truth)) as flight,
    ):
        session.show(show, flight, lambda: os.kill(os.getpid(), signal.SIGINT))
    if flight.unrecorded:
        raise StartError(f"{runs}: the flight was not recorded, so not judged: {flight.unrecorded}")
    if flight.folder is None:
        return None
    # A second Ctrl-C ends this station, and not the agents, which land as they are told.
    ending = Ending(interrupts.first, interrupts.again) if interrupts.count else None
    summary = summarise(flight.folder, None, ending)
    with contextlib.suppress(OSError):  # a full disk: it is shown all the same
        write_summary(flight.folder, summary)
    return JudgedRun(flight.folder, summary, interrupts.count)


class _Flight(Control):
    """What such a station obeys: it ends with the agents, or with the second Ctrl-C. Its record
    begins when the first agent is heard: the mission's clock is that one's."""

    def __init__(
        self,
        swarm: SwarmElsewhere,
        runs: Path,
        interrupts: Interrupts,
        alive: Callable[[], None],
        live: Sequence[Sink],
        truth: Path | None = None,
    ) -> None:
        self._swarm = swarm
        self._hint = Hint(swarm, records=True)
        self._source = truth
        self._runs = runs
        self._interrupts = interrupts
        self._alive = alive
        self._live = live
        self._asked = False
        self._recorder: Accounts | None = None
        self._life = Rim("the sign of life")
        self._begin = Rim("the record of the run", most=1)
        self._manifest: Manifest | None = None
        self.folder: Path | None = None
        self.unrecorded = ""
        """Why the run has no record; '' while it has, or no agent was heard."""

    def obey(self, station: Station, screen: Screen) -> bool:
        self._life.run(self._alive)
        if text := station.shows.run(self._hint):
            screen.note(text)
        view = station.seen()
        if self.folder is None and self._swarm.clock.heard:
            self._begin.run(self._record, station, screen)
        for trouble in (*self._life.troubles(), *self._begin.troubles()):
            self.unrecorded = trouble.why if trouble.part == self._begin.part else self.unrecorded
            screen.note(str(trouble))
        if self._interrupts.count and not self._asked:
            self._asked = True
            words = "landing the swarm; Ctrl-C again ends this station, and not the agents"
            screen.note(f"{self._interrupts.first}: {words}")
            give(Order("land"), station, screen)
        if self._interrupts.again or (self._asked and self.folder is None) or screen.left:
            return True
        if view is None:
            return False
        told = [a for a in view.agents if a.in_plan and a.status is not None]
        return bool(told) and all(map(_has_ended, told))

    def _record(self, station: Station, screen: Screen) -> None:
        folder = make_folder(self._runs, self._swarm.plan.name)
        manifest = _manifest(self._swarm)
        write_manifest(folder, manifest)
        self._manifest = manifest
        mcap = run_mcap(folder, manifest, station.name, self._live)
        self._recorder, self.folder = Accounts(folder, mcap), folder
        station.record(self._recorder)
        screen.note(f"run folder {folder}")

    def close(self) -> None:
        """Write what the agents told at their end, and close the record."""
        if self._recorder is not None:
            with closing(self._recorder) as recorder:
                self._begin.run(recorder.write_accounts)
                self._begin.run(self._take_truth, recorder)

    def _take_truth(self, recorder: RunRecorder) -> None:
        """Without it the run is judged by estimates, and a warning of the summary says why."""
        now_s = self._swarm.clock.now()
        if self._source is None or self.folder is None or self._manifest is None:
            return
        # The clock has followed its agent's fastest message since the record began.
        epoch_s = wall.wall_s() - now_s / self._swarm.clock.speedup
        manifest = self._manifest.model_copy(update={"epoch_s": epoch_s})
        try:
            take_truth(self._source, self.folder, manifest, now_s)
        except InputError as error:
            recorder.note(Trouble("the simulator's truth", str(error), off=False), now_s)
        except OSError as error:
            why = f"{self._source}: {error.strerror}"
            recorder.note(Trouble("the simulator's truth", why, off=False), now_s)


def _has_ended(agent: AgentView) -> bool:
    status = agent.status
    if status is None or status.outcome is not Outcome.RUNNING:
        return True
    return agent.silence_s is not None and agent.silence_s > _SILENT_S


def _manifest(swarm: SwarmElsewhere) -> Manifest:
    plan, fleet, clock, now_s = swarm.plan, swarm.fleet, swarm.clock, swarm.clock.now()
    trust, identity = fleet.trust, swarm.identity
    return Manifest(
        mission=str(swarm.source),
        swarm=plan.name,
        started_at=wall.date_and_time(now_s / clock.speedup),
        speedup=clock.speedup,
        epoch_s=wall.wall_s() - now_s / clock.speedup,
        headless=True,
        plan=plan,
        plan_hash=plan.fingerprint(),
        fleet=fleet.agents,
        simulated=(),
        elsewhere=True,
        trust=None if trust is None else str(Path(trust).absolute()),
        signing=fleet.signing,
        identity=None if identity is None else str(identity.folder.absolute()),
        open_mesh=swarm.is_open,
        versions=package_versions(),
    )


class Accounts(RunRecorder):
    """Records, and keeps each agent's last status, by the station's clock: an agent that ended has
    told it for seconds, and has no file in this station's folder."""

    def __init__(self, folder: Path, mcap: McapRecorder) -> None:
        super().__init__(folder, mcap)
        self._folder = folder / FINAL
        self._last: dict[int, AgentStatus] = {}
        self._behind_s: dict[int, float] = {}
        """The station's clock less the agent's, by its fastest message."""
        self._seq: dict[int, int] = {}

    def take(self, payload: Payload, received_s: float) -> None:
        """Record a message, and note whose clock it tells."""
        super().take(payload, received_s)
        if isinstance(payload, AgentState):
            if payload.seq < self._seq.get(payload.agent, 0) // 2:
                # a new process, by a clock of its own; a late state is not so far behind
                self._behind_s.pop(payload.agent, None)
            self._seq[payload.agent] = payload.seq
        if isinstance(payload, AgentState | AgentStatus):
            behind_s = received_s - payload.time_s
            known_s = self._behind_s.get(payload.agent, math.inf)
            self._behind_s[payload.agent] = min(known_s, behind_s)
        if isinstance(payload, AgentStatus):
            self._last[payload.agent] = payload

    def write_accounts(self) -> None:
        """Write the last word of each agent that has ended; the others have no account."""
        self._folder.mkdir(exist_ok=True)
        for agent, status in self._last.items():
            if status.outcome is not Outcome.RUNNING:
                later = shifted(status, self._behind_s[agent])
                with replacing(self._folder / f"{agent}.json") as file:
                    file.write(_STATUS.dump_json(later, indent=1))


_FRESH_WALL_S: Final = 2.0
"""A simulator that goes on has written a line by then, also on a busy machine: its truth ends as
well as with its own last line. An older one ended with the simulator."""


def take_truth(source: Path, folder: Path, manifest: Manifest, now_s: float) -> None:
    """Copy what `sim --truth` has written on this computer into the run's folder; from then on the
    run is judged by it. `now_s`: mission time by the run's clock.

    Raises:
        InputError: it is not the truth of this flight; the words say why.
        OSError: it can't be read or written.
    """
    lines = _objects(source)
    header = _header(source, next(lines, None))
    if header.speedup != manifest.speedup:
        raise InputError(f"{source} has speed-up {header.speedup:g}, this run {manifest.speedup:g}")
    if header.epoch_s is None:
        raise InputError(f"{source} does not say when its clock began")
    later_s = (header.epoch_s - manifest.epoch_s) * manifest.speedup
    last: dict[str, Any] = header.model_dump(by_alias=True)
    with replacing(folder / TRUTH) as file:
        file.write(_line(last, later_s))
        for last in lines:
            file.write(_line(last, later_s))
        last_s = last["t"] + later_s
        if last_s < 0.0:
            raise InputError(f"{source} ends {-last_s:.0f} s before this flight")
        if last["type"] != "end" and last_s > now_s - _FRESH_WALL_S * manifest.speedup:
            file.write(_line({"type": "end", "t": last["t"]}, later_s))
    there = set(header.sysids)
    simulated = tuple(agent.id for agent in manifest.fleet if agent.sysid in there)
    write_manifest(folder, manifest.model_copy(update={"simulated": simulated}))


def _header(source: Path, first: dict[str, Any] | None) -> TruthHeader:
    try:
        return TruthHeader.model_validate(first)
    except ValidationError:
        raise InputError(f"{source}: no truth; allowed: what sim --truth writes") from None


def _objects(path: Path) -> Iterator[dict[str, Any]]:
    """All whole lines that have a time; the judge reads the rest of each."""
    for line in read_lines(path, Damage()):
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict) and isinstance(found.get("t"), int | float) and "type" in found:
            yield found


def _line(of: dict[str, Any], later_s: float) -> bytes:
    moved = of | {"t": round(of["t"] + later_s, 4)}
    return json.dumps(moved, separators=(",", ":")).encode() + b"\n"
