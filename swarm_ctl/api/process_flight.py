"""A flight with real processes, in its own folder and on its own ports."""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from pydantic import TypeAdapter

from swarm_ctl.api.flight import FlightError, FlightResult, SwarmFlight
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import AgentStatus, Event
from swarm_ctl.core.model.messages import Phase as AgentPhase
from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.flying_runs import PROCESSES
from swarm_ctl.engine.launch.flight_process import FlightProcess, ProgramFlight
from swarm_ctl.engine.launch.run_setup import Lockstep, RunOptions
from swarm_ctl.engine.lockstep.seat import STATION, TEST, BarrierSeat
from swarm_ctl.engine.lockstep.words import TickPhase
from swarm_ctl.engine.protection import Keys
from swarm_ctl.engine.station.run_client import RunClient
from swarm_ctl.engine.station.screens import Show
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import LoadedMission, dumps
from swarm_ctl.report.judge.summary import SUMMARY, Summary
from swarm_ctl.runfolder.last_statuses import read_events, read_last_statuses, read_statuses
from swarm_ctl.runfolder.manifest import read_manifest
from swarm_ctl.runfolder.truth import TRUTH, EventKind, load_truth
from swarm_ctl.station.picture.view import SwarmView
from swarm_ctl.virtual.as_processes import run_script
from swarm_ctl.virtual.scenario import Scenario

_START_WALL_S = 80.0
"""`run` itself gives its processes 40 s, and says then which one did not start."""
_POLL_WALL_S = 0.05
_END_WALL_S = 15.0
"""A second Ctrl-C kills all processes at once; a busy machine needs time for it."""
_LOCKSTEP_END_WALL_S = 120.0
"""From the last agent's end to the run's, in lockstep."""
_AGAIN_WALL_S = 0.8
"""Two presses of Ctrl-C, and not one."""
_ENDED_BY = "ended by its program"
_LAST_LINES = 20
_LAND_WALL_S = 300.0
_KILL_WALL_S, _SHORT_WALL_S = 10.0, 0.002


class ProcessFlight(SwarmFlight):
    """`folder` is the run folder.

    Args:
        mission: to fly.
        where: for what the flight's process is told, and its log.
        speedup: in real time, so many times as fast; None: in lockstep, and while the test does not
            wait, mission time stands still.
        seed: of all random numbers.
        vehicles: the kinds of those that the run starts; None: the fleet's.
        apart: Ctrl-C in the terminal does not reach the run.
        runs: where the run folder is made; None: in `where`.
        scenario: what befalls it; it has its own seed.
        report: one is made at the end.
        tlog: each vehicle's MAVLink frames are recorded.
    """

    _cut = False
    """It was ended in flight: what the verdict says of its end is this module's doing."""

    def __init__(
        self,
        mission: LoadedMission,
        where: Path,
        speedup: float | None,
        seed: int = 1,
        *,
        vehicles: str | None = None,
        apart: bool = False,
        runs: Path | None = None,
        scenario: Scenario | None = None,
        report: bool = True,
        tlog: bool = True,
    ) -> None:
        super().__init__(mission.plan, scenario)
        self._struck: dict[str, signal.Signals] = {}
        """Processes that a signal is to come to, after the next tick."""
        self._seat: BarrierSeat | None = None
        self._client: RunClient | None = None
        if scenario is not None and speedup is not None:
            raise InputError(
                f"speedup={speedup:g}: a scenario flies in lockstep; allowed: no speedup"
            )
        where.mkdir(parents=True, exist_ok=True)
        options = RunOptions(
            speedup=speedup or 1.0,
            show=Show.LOG,
            runs=runs or where,
            seed=seed if scenario is None else scenario.seed,
            tlog=tlog,
            lockstep=Lockstep(further=(TEST,)) if speedup is None else None,
            keys=Keys(fleet_file=str(mission.source)),
            script=None if scenario is None else run_script(scenario, mission.plan),
        )
        named = str(mission.source.absolute())
        flight = ProgramFlight(dumps(mission.file), named, options, vehicles, report)
        self._process = FlightProcess(where, flight, apart=apart)
        try:
            self.folder = self._wait_started(options.runs)
            self._pids: dict[str, int] = json.loads((self.folder / PROCESSES).read_text())
            if (address := read_manifest(self.folder).lockstep) is not None:
                self._seat = BarrierSeat(address, TickPhase.AFTER, 1.0)
            self._client = RunClient(self.folder, self._seat)
        except BaseException:
            self.close()
            raise

    def _wait_started(self, runs: Path) -> Path:
        """The folder of the run in `runs`."""
        until, seen = wall_s() + _START_WALL_S, set[Path]()
        while not self._process.over and wall_s() < until:
            for folder in {path.parent for path in runs.glob(f"*/{PROCESSES}")} - seen:
                if read_manifest(folder).process == self._process.pid:
                    return folder
                seen.add(folder)
            pause(_POLL_WALL_S)
        raise FlightError(f"the run did not start:\n{self._process.said(_LAST_LINES)}")

    @property
    def now(self) -> float:
        return self._mesh.now()

    def turn(self) -> None:
        self._mesh.newest()
        self._mesh.turn()
        self._signal_struck()
        self.observed()

    def reached(self, step: int, agents: Collection[int] = ()) -> bool:
        newest = self._mesh.newest().items()
        states = [s for i, s in newest if (i in agents or not agents) and s.left is None]
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
        return no_agent or self._process.over

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
        if not self._flown(within_s):
            raise FlightError(f"the run did not end within {within_s:g} s; see {self.folder}")
        self.close()
        folder = self.folder
        summary = self._summary()
        if summary is None:
            raise FlightError(f"the run left no summary:\n{self._process.said(_LAST_LINES)}")
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

    def _flown(self, within_s: float) -> bool:
        """Until the run has ended, and whether it has; in lockstep the test leaves the barrier with
        the last agent."""
        if self._seat is not None:
            self.wait_s(within_s)
            self._leave()
            return self._process.wait(_LOCKSTEP_END_WALL_S)
        self._leave()
        return self._process.wait(_END_WALL_S + within_s / read_manifest(self.folder).speedup)

    def _leave(self) -> None:
        self._signal_struck()
        if self._client is not None:
            self._client.close()
            self._client = None

    def land(self) -> None:
        self._leave()
        self._process.land(_ENDED_BY)
        if not self._process.wait(_LAND_WALL_S):
            why = f"the swarm did not land within {_LAND_WALL_S:g} s; see {self.folder}"
            raise FlightError(why)

    def close(self) -> None:
        """Interrupt the run twice, as an impatient operator does: it ends all its processes."""
        self._leave()
        self._cut = self._cut or not self._process.over
        for _ in range(2):
            self._process.interrupt()
            self._process.wait(_AGAIN_WALL_S)
        self._process.wait(_END_WALL_S)
        self._process.kill()


def _lives(pid: int) -> bool:
    """It has not ended; one that its parent has not looked after yet has."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
