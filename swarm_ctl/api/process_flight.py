"""A flight with real processes: `swarm-ctl run` in its own folder and on its own ports."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import IO

from pydantic import TypeAdapter

from swarm_ctl.api.flight import FlightError, FlightResult, SwarmFlight
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import AgentStatus, Event
from swarm_ctl.core.model.messages import Phase as AgentPhase
from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.lockstep.seat import STATION, TEST, BarrierSeat
from swarm_ctl.engine.lockstep.words import TickPhase
from swarm_ctl.engine.station.run_client import RunClient
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import LoadedMission, dumps
from swarm_ctl.report.judge.summary import SUMMARY, Summary
from swarm_ctl.runfolder.last_statuses import read_events, read_last_statuses, read_statuses
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.runfolder.truth import TRUTH, EventKind, load_truth
from swarm_ctl.station.picture.view import SwarmView
from swarm_ctl.virtual.as_processes import run_script
from swarm_ctl.virtual.scenario import Scenario, mission_source, scenario_text

_START_WALL_S = 80.0
"""`run` itself gives its processes 40 s, and says then which one did not start."""
_POLL_WALL_S = 0.05
_END_WALL_S = 15.0
"""A second Ctrl-C kills all processes at once; a busy machine needs time for it."""
_LOCKSTEP_END_WALL_S = 120.0
"""From the last agent's end to the run's, in lockstep."""
_AGAIN_WALL_S = 0.8
"""Two presses of Ctrl-C, and not one."""
_ENDED_BY = b"ended by its program"
_LAND_WALL_S = 300.0
_KILL_WALL_S, _SHORT_WALL_S = 10.0, 0.002


class ProcessFlight(SwarmFlight):
    """`folder` is the run folder.

    Args:
        mission: to fly.
        where: for the mission's file and the run's output.
        runs: where the run folder is made; None: in `where`.
        speedup: in real time, so many times as fast; None: in lockstep, and while the test does not
            wait, mission time stands still.
        seed: of all random numbers.
        arguments: more of `swarm-ctl run`.
        apart: Ctrl-C in the terminal does not reach the run.
    """

    _cut = False
    """It was ended in flight: what the verdict says of its end is this module's doing."""

    def __init__(
        self,
        mission: LoadedMission,
        where: Path,
        speedup: float | None,
        seed: int = 1,
        arguments: Sequence[str] = (),
        *,
        apart: bool = False,
        runs: Path | None = None,
        scenario: Scenario | None = None,
    ) -> None:
        super().__init__(mission.plan, scenario)
        self._struck: dict[str, signal.Signals] = {}
        """Processes that a signal is to come to, after the next tick."""
        self._seat: BarrierSeat | None = None
        self._client: RunClient | None = None
        where.mkdir(parents=True, exist_ok=True)
        file = where / ("mission.yaml" if scenario is None else "scenario.yaml")
        self._named = str(file)
        if scenario is None:
            file.write_text(dumps(mission.file))
        else:
            self._named = _write_scenario(file, scenario, mission, speedup)
        self._where = where
        self._before = {path.parent for path in (runs or where).glob("*/processes.json")}
        self._log: IO[bytes] = (where / "run.log").open("wb")
        command = [sys.executable, "-m", "swarm_ctl.cli.main", "run", str(file), "--headless"]
        command += [] if scenario is not None else ["--seed", str(seed)]
        command += ["--runs", str(runs or where), "--speedup"]
        command += ["max", "--lockstep-with", TEST] if speedup is None else [str(speedup)]
        command += arguments
        # Its end is ours, however this program ends: then the swarm lands.
        theirs, self._lifeline = os.pipe()
        command += ["--lifeline", str(theirs)]
        self._process = subprocess.Popen(
            command,
            pass_fds=(theirs,),
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            process_group=0 if apart else None,
        )
        os.close(theirs)
        try:
            self.folder = self._wait_started(where, runs or where)
            self._pids: dict[str, int] = json.loads((self.folder / "processes.json").read_text())
            if (address := read_manifest(self.folder).lockstep) is not None:
                self._seat = BarrierSeat(address, TickPhase.AFTER, 1.0)
            self._client = RunClient(self.folder, self._seat)
        except BaseException:
            self.close()
            raise

    def _wait_started(self, where: Path, runs: Path) -> Path:
        """The folder in `runs` of the run that flies the mission file in `where`."""
        until, named = wall_s() + _START_WALL_S, self._named
        while not (
            found := [
                file
                for file in runs.glob("*/processes.json")
                if file.parent not in self._before and read_manifest(file.parent).mission == named
            ]
        ):
            if self._process.poll() is not None or wall_s() > until:
                raise FlightError(f"the run did not start:\n{self._tail(where)}")
            pause(_POLL_WALL_S)
        return found[0].parent

    @staticmethod
    def _tail(where: Path) -> str:
        return "\n".join((where / "run.log").read_text(errors="replace").splitlines()[-20:])

    @property
    def now(self) -> float:
        return self._mesh.now()

    def turn(self) -> None:
        self._mesh.newest()
        self._mesh.turn()
        self._signal_struck()
        self.observed()

    def reached(self, step: int, agents: Collection[int] = ()) -> bool:
        states = [s for i, s in self._mesh.newest().items() if i in agents or not agents]
        return len(states) > 0 and all(state.step >= step for state in states)

    def view(self) -> SwarmView:
        return self._mesh.view()

    @property
    def _mesh(self) -> RunClient:
        if self._client is None:
            raise FlightError("the flight is over")
        return self._client

    @property
    def over(self) -> bool:
        """The run has ended, or in lockstep its last agent."""
        no_agent = self._seat is not None and self._seat.agents == 0
        return no_agent or self._process.poll() is not None

    def give(self, order: Order) -> SentCommand:
        return self._mesh.give(order)

    def order(self, order: Order) -> SentCommand:
        return self._mesh.order(order)

    @property
    def up(self) -> tuple[int, ...]:
        ended = {i for i, s in self.statuses().items() if s.phase is AgentPhase.ENDED}
        return tuple(agent.id for agent in self.plan.agents if agent.id not in ended)

    def kill_agent(self, agent: int) -> None:
        self._strike(f"agent-{self.known(agent)}", signal.SIGKILL)

    def freeze_agent(self, agent: int) -> None:
        self._strike(f"agent-{self.known(agent)}", signal.SIGSTOP)

    def thaw_agent(self, agent: int) -> None:
        name = f"agent-{self.known(agent)}"
        self._struck.pop(name, None)
        os.kill(self._pids[name], signal.SIGCONT)
        if self._seat is not None:
            self._seat.take(name)

    def kill_station(self) -> None:
        self._strike(STATION, signal.SIGKILL)

    def _strike(self, name: str, by: signal.Signals) -> None:
        """The next tick is without this process. In lockstep the signal comes after that tick: till
        then its last messages may be on their way out of it, and no tick decides which are."""
        if self._seat is None:
            self._signal(name, by)
        else:
            self._seat.drop(name)
            self._struck[name] = by

    def _signal_struck(self) -> None:
        while self._struck:
            self._signal(*self._struck.popitem())

    def _signal(self, name: str, by: signal.Signals) -> None:
        """Until it is dead, if it is to be."""
        pid, until = self._pids[name], wall_s() + _KILL_WALL_S
        os.kill(pid, by)
        while by is signal.SIGKILL and _lives(pid) and wall_s() < until:
            pause(_SHORT_WALL_S)

    def events(self) -> Sequence[Event]:
        return tuple(read_events(self.folder, []))

    def statuses(self) -> Mapping[int, AgentStatus]:
        ids = [agent.id for agent in self.plan.agents]
        last = read_last_statuses(self.folder, read_statuses(self.folder, []), ids, [])
        live = self._client.statuses() if self._client is not None else {}
        return {agent: found.status for agent, found in last.items()} | live

    @property
    def where(self) -> str:
        from swarm_ctl.report.page.html_page import PAGE
        from swarm_ctl.report.page.summary_table import verdict_line

        page = self.folder / PAGE
        report = str(page) if page.exists() else f"none yet; swarm-ctl report {self.folder}"
        summary = self._summary()
        verdict = verdict_line(summary).plain if summary else "none yet"
        if self._cut:
            verdict = "none: the flight was ended with the test"
        return f"verdict: {verdict}\nrun folder: {self.folder}\nreport: {report}"

    def _summary(self) -> Summary | None:
        """The run's, once it has ended."""
        file = self.folder / SUMMARY
        return TypeAdapter(Summary).validate_json(file.read_bytes()) if file.exists() else None

    def finish(self, within_s: float | None = None) -> FlightResult:
        __tracebackhide__ = True
        within_s = self.bound_s if within_s is None else within_s
        try:
            self._fly_on(within_s)
        except subprocess.TimeoutExpired:
            why = f"the run did not end within {within_s:g} s; see {self.folder}"
            raise FlightError(why) from None
        self.close()
        folder = self.folder
        summary = self._summary()
        if summary is None:
            raise FlightError(f"the run left no summary:\n{self._tail(self._where)}")
        final = [each for each in summary.agents if each.account == "final"]
        outcomes = {each.agent: str(each.outcome) for each in final}
        apart_m = math.inf if summary.min_distance_m is None else summary.min_distance_m
        truth = load_truth(folder / TRUTH) if (folder / TRUTH).exists() else None
        down = not any(each.armed or each.airborne for each in summary.agents)
        if truth is not None:
            ups = sorted(e.sysid for e in truth.events if e.event == EventKind.LIFTOFF)
            downs = sorted(e.sysid for e in truth.events if e.event == EventKind.TOUCHDOWN)
            down = ups == downs
        return FlightResult(
            outcomes=outcomes,
            closest_m=apart_m,
            all_down=down,
            events=tuple(self.events()),
            summary=summary,
            truth=truth,
            folder=folder,
        )

    def _fly_on(self, within_s: float) -> None:
        """Until `run` has ended; in lockstep the test leaves the barrier with the last agent."""
        if self._seat is not None:
            self.wait_s(within_s)
            self._leave()
            self._process.wait(_LOCKSTEP_END_WALL_S)
            return
        self._leave()
        speedup = read_manifest(self.folder).speedup
        self._process.wait(_END_WALL_S + within_s / speedup)

    def _leave(self) -> None:
        self._signal_struck()
        if self._client is not None:
            self._client.close()
            self._client = None

    def land(self) -> None:
        self._leave()
        if self._process.poll() is None:
            with contextlib.suppress(OSError):  # it has ended meanwhile
                os.write(self._lifeline, _ENDED_BY)
            try:
                self._process.wait(_LAND_WALL_S)
            except subprocess.TimeoutExpired:
                why = f"the swarm did not land within {_LAND_WALL_S:g} s; see {self.folder}"
                raise FlightError(why) from None

    def close(self) -> None:
        """Interrupt the run twice, as an impatient operator does: it ends all its processes."""
        self._leave()
        self._cut = self._cut or self._process.poll() is None
        for _ in range(2):
            if self._process.poll() is None:
                self._process.send_signal(signal.SIGINT)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(_AGAIN_WALL_S)
        try:
            self._process.wait(_END_WALL_S)
        except subprocess.TimeoutExpired:
            self._process.kill()  # its children notice through their pipes and land
            self._process.wait()
        self._log.close()
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1


def _write_scenario(
    file: Path, scenario: Scenario, mission: LoadedMission, speedup: float | None
) -> str:
    """Where it can be flown from; what its run calls its mission."""
    if speedup is not None:
        raise InputError(f"speedup={speedup:g}: a scenario flies in lockstep; allowed: no speedup")
    run_script(scenario, mission.plan)  # refuses what processes can't do
    if isinstance(scenario.mission, str):
        scenario = scenario.model_copy(update={"mission": str(mission.source.absolute())})
    file.write_text(scenario_text(scenario))
    return str(mission_source(scenario, file.parent))


def _lives(pid: int) -> bool:
    """It has not ended; one that its parent has not looked after yet has."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
