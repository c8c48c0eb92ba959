"""A whole run on this machine: starts simulator, agents and station, watches them, ends them.

The order at the end: vehicles come down first, then processes end, then the summary is written.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import termios
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.flying_runs import PROCESSES
from swarm_ctl.engine.interrupts import Interrupts
from swarm_ctl.engine.launch.forked import ROUTER_HUNG_WALL_S, AgentChild, HostRouter, RadioLink
from swarm_ctl.engine.launch.processes import (
    Child,
    CommandChild,
    VehiclesChild,
    keeper,
    relay,
    simulator,
    station,
    wait_all,
    wait_ready,
)
from swarm_ctl.engine.launch.run_setup import RunOptions, RunSetup
from swarm_ctl.engine.station.screens import Show
from swarm_ctl.engine.vehicle_memory import left_changed
from swarm_ctl.engine.vehicles.vehicles_process import READY_WALL_S
from swarm_ctl.errors import StartError, SwarmError
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary, write_summary
from swarm_ctl.report.judge.verdict import Ending
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder.files import write_whole
from swarm_ctl.runfolder.last_statuses import flying_successors

_START_WALL_S: Final = 20.0
"""From the first process to the last `ready`; a loaded two-core machine needs 1 to 2 s."""
_BOOT_WALL_S: Final = READY_WALL_S + 10.0
"""The process that starts the autopilots gives up before that, and says which one was late."""
_POLL_WALL_S: Final = 0.05
_LANDED_WALL_S: Final = 60.0
"""By then most swarms are down: who still waits is to know for whom."""
_LAND_WALL_S: Final = 3.0
"""After Ctrl-C, without a station that could pass the command on: then the lifelines are cut."""
_HUNG_WALL_S: Final = 20.0
"""An agent that has been silent for this long is killed, so that a hung process can't hang the run;
its vehicle's failsafe has acted long before. Generous: an agent that is only suspended for a while
comes back by itself."""
_HUNG_STALLED_WALL_S: Final = 5.0
"""In lockstep: so long after the clock went on without it, so that one that was only suspended can
come back. All else has ended soon, and the clock ticks on for the station alone."""
_SILENT_S: Final = 10.0
"""Mission time without a status of a process that took a vehicle over: it is gone, too."""
_LOOK_WALL_S: Final = 0.25
_GROUND_WALL_S: Final = 5.0
"""For each process to end of a run that has not taken off."""
_AGENTS_S: Final = 200.0
"""Mission time for the agents to bring their vehicles down."""
_SIMULATOR_S: Final = 100.0
"""The simulator, and the process of the autopilots, wait 90 s for vehicles that still fly."""
_SIMULATOR_WALL_S: Final = 5.0
_STATION_WALL_S: Final = 10.0
_RELAY_WALL_S: Final = 1.0
"""It ends when no vehicle that it hears is armed."""
_LINK_WALL_S: Final = 3.0
"""It ends when no agent speaks."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended. `interrupts`: how often Ctrl-C was pressed."""

    folder: Path
    summary: Summary
    interrupts: int


def fly(
    mission: LoadedMission,
    options: RunOptions,
    say: Callable[[str], None],
    show: Callable[[Path, Summary, Interrupts], None],
) -> RunResult:
    """Fly a mission to its end, then `show` its summary; StartError when something did not start
    (nothing is left running then)."""
    with Interrupts(options.lifeline) as interrupts:
        setup = RunSetup(mission, options)
        processes = RunProcesses(setup, interrupts, say)
        failure: SwarmError | OSError | None = None
        try:
            if processes.start():
                processes.watch()
        except (SwarmError, OSError) as error:
            failure = error
        finally:
            processes.end()
            setup.ground_control.held.close()
        if failure is not None:
            if isinstance(failure, OSError):
                where = failure.filename or setup.folder
                why = f"{where}: can't be written: {failure.strerror}; choose with --runs"
                failure = StartError(why)
            ending = Ending(str(failure).partition("\n")[0], failed=True)
            _write_summary(setup.folder, processes, ending, say)
            raise failure
        rim = Rim("the end of the run")
        for agent, own in sorted((rim.run(left_changed, setup.folder) or {}).items()):
            values = ", ".join(f"{name} {value.own:g}" for name, value in own.values.items())
            say(
                f"agent {agent}: its vehicle has not confirmed its own failsafe parameters"
                f" ({values}); the next flight puts them back, or swarm-ctl doctor --restore"
            )
        ended = Ending(interrupts.first, interrupts.again) if interrupts.count else None
        summary = _write_summary(setup.folder, processes, ended, say)
        rim.run(show, setup.folder, summary, interrupts)
        for trouble in rim.troubles():
            say(f"{trouble.part}: {trouble.why}; the flight's result stands: {summary.outcome}")
        return RunResult(setup.folder, summary, interrupts.count)


def _write_summary(
    folder: Path, processes: RunProcesses, ending: Ending | None, say: Callable[[str], None]
) -> Summary:
    rim = Rim("the summary")
    summary = summarise(folder, processes.exit_codes(), ending)
    rim.run(write_summary, folder, summary)
    for trouble in rim.troubles():  # a full disk: `run` shows the summary all the same
        say(f"the summary can't be written: {trouble.why}")
        if ending is not None and ending.failed:
            shutil.rmtree(folder, ignore_errors=True)  # nothing flew, and it could say nothing
        elif summary.outcome is Outcome.FAILED:  # agents may have left no account for that alone
            reason = f"the run folder can't be written: {trouble.why}. {summary.reason}"
            summary = summary.model_copy(update={"reason": reason})
    return summary


class _EndedEarly(Exception):  # noqa: N818 - no error
    """The run is ended before all its processes work."""


class RunProcesses:
    """The processes of one run."""

    def __init__(self, setup: RunSetup, interrupts: Interrupts, say: Callable[[str], None]) -> None:
        self._setup = setup
        self._interrupts = interrupts
        self._print = say
        self._vehicles: VehiclesChild | None = None
        self._simulator: CommandChild | None = None
        self._agents: list[AgentChild] = []
        self._links: list[RadioLink] = []
        self._station: CommandChild | None = None
        self._relay: CommandChild | None = None
        self._keeper: CommandChild | None = None
        self._router: HostRouter | None = None
        self._alone = False
        """It has been said that the station is gone."""
        self._terminal = TerminalState()
        self._telling = Rim("what the processes of the run tell")
        self._waiting = Waiting(self._say, self._keep_router)

    @property
    def _children(self) -> list[Child]:
        needed = (self._vehicles, self._simulator, *self._links, *self._agents, self._station)
        router = self._router.child if self._router is not None else None
        children = (*needed, self._relay, self._keeper, router)
        return [child for child in children if child is not None]

    def start(self) -> bool:
        """Start autopilots first, then everything else side by side, and wait until every process
        has said that it works; False where the run was ended meanwhile."""
        try:
            self._start()
        except _EndedEarly:
            return False
        except BaseException:
            self._kill_all()  # no vehicle is armed yet
            raise
        return True

    def _start(self) -> None:
        setup, folder = self._setup, self._setup.folder
        self._start_vehicles()
        agents, radios = setup.manifest.fleet, setup.radios
        sim_config = setup.write_simulator_config()
        setup.write_launch()
        for line in setup.table():
            self._print(line)
        simulators = "1 simulator, " if sim_config else ""
        routed = bool(setup.manifest.routers)
        router = "1 router, " if routed else ""
        links = f"{len(radios)} link, " if radios else ""
        what = f"{simulators}{router}{links}{len(agents)} agents, 1 station"
        self._print(f"starting {what}; run folder {folder}")
        if setup.options.lockstep is not None:
            self._keeper = keeper(folder)
            self._wait_ready(_START_WALL_S)
        if routed:
            self._router = HostRouter(folder, self._say, self._patience_wall_s)
        # before the agents, whose ticks take the processors from its imports; many agents
        # would not leave it any
        self._go_on()
        self._station = station(folder)
        if routed:
            self._wait_ready(_START_WALL_S)
        if sim_config:
            self._simulator = simulator(sim_config, folder / "simulator.log")
        for k, radio in enumerate(radios, start=1):
            self._links.append(RadioLink(folder, k, radio))
        (folder / "agents").mkdir()
        for agent in agents:
            self._go_on()
            self._agents.append(AgentChild(folder, agent.id))
        if setup.options.gcs:
            self._relay = relay(folder)
        self._wait_ready(_START_WALL_S)
        self._write_pids()

    def _write_pids(self) -> None:
        pids = {child.name: child.pid for child in self._children}
        try:
            write_whole(self._setup.folder / PROCESSES, json.dumps(pids))
        except OSError as error:  # the swarm may fly already
            self._say(f"{PROCESSES} can't be written: {error.strerror}; send can't find this run")

    def _start_vehicles(self) -> None:
        """Start the autopilots of the run, if it has any, and say where each is."""
        folder = self._setup.write_orders()
        if folder is None:
            return
        self._print(f"starting autopilots; they boot for a while; their files: {folder}")
        self._vehicles = VehiclesChild(folder, self._setup.folder / "vehicles.log")
        self._wait_ready(_BOOT_WALL_S)
        started = self._vehicles.started()
        self._setup.take_started(started)

    def _wait_ready(self, wall_seconds: float) -> None:
        late = wait_ready(self._children, wall_seconds, lambda: self._interrupts.count > 0)
        self._go_on()
        if late:
            names, folder = ", ".join(child.name for child in late), self._setup.folder
            raise StartError(
                f"not ready, {wall_seconds:g} s after all others: {names}; see the logs in {folder}"
            )

    def _go_on(self) -> None:
        """What is to be ended starts no further process."""
        if self._interrupts.count:
            raise _EndedEarly

    def watch(self) -> None:
        """Until all agents have ended, or the second Ctrl-C. The first one lands the swarm."""
        asked_s: float | None = None
        while any(agent.exit_code() is None for agent in self._agents):
            if self._interrupts.again:
                return
            now = wall.wall_s()
            if self._interrupts.count and asked_s is None:
                asked_s = now
                self._say(
                    f"{self._interrupts.first}: landing the swarm; Ctrl-C again stops everything at"
                    " once"
                )
                self._ask_to_land()
            if not self._station_lives():
                self._without_station()
                if asked_s is not None and now > asked_s + _LAND_WALL_S:
                    self._let_agents_go()
            elif asked_s is not None and now > asked_s + _LANDED_WALL_S:
                whose = "a pilot who has its vehicle lands it"
                self._waiting.tell(f"{named(self._agents)} to end ({whose})")
            self._telling.run(self._tell_news)
            self._kill_hung()
            self._keep_router()
            wall.pause(_POLL_WALL_S)

    def _tell_news(self) -> None:
        """What the other processes have to say."""
        for child in (self._relay, self._keeper, self._simulator, *self._links):
            for note in child.notes() if child is not None else ():
                self._say(note)

    def _without_station(self) -> None:
        """Nothing else tells what goes on."""
        self._terminal.restore()  # else Ctrl-C would be a key that no process reads
        if not self._alone:
            self._alone = True
            policies = self._setup.manifest.plan.policies
            rule = f"{policies.station_lost} after {policies.station_lost_after_s:g} s"
            self._print(f"the ground station has ended; the mission's policy without one: {rule}")
        hint = "" if self._interrupts.count else " (Ctrl-C lands them)"
        self._waiting.tell(f"{named(self._agents)} to end{hint}")

    def _kill_hung(self) -> None:
        for agent in self._agents:
            if agent.exit_code() is None and agent.silent_wall_s() > self._hung_wall_s:
                self._say(f"{agent.name} has hung for {self._hung_wall_s:g} s and is killed")
                agent.kill()

    @property
    def _hung_wall_s(self) -> float:
        lockstep = self._setup.options.lockstep
        return lockstep.patience_wall_s + _HUNG_STALLED_WALL_S if lockstep else _HUNG_WALL_S

    @property
    def _patience_wall_s(self) -> float:
        lockstep = self._setup.options.lockstep
        return lockstep.patience_wall_s if lockstep is not None else ROUTER_HUNG_WALL_S

    def _keep_router(self) -> None:
        if self._router is not None and self._router.look():
            self._write_pids()

    def _say(self, text: str) -> None:
        """On the dashboard while that has the terminal."""
        dashboard = self._station if self._setup.options.show is Show.DASHBOARD else None
        if dashboard is None or not dashboard.say(note=text):
            self._print(text)

    def _station_lives(self) -> bool:
        return self._station is not None and self._station.exit_code() is None

    def _ask_to_land(self) -> None:
        if self._station is None or not self._station.say(command="land"):
            self._let_agents_go()

    def _let_agents_go(self) -> None:
        for agent in self._agents:
            agent.let_go()

    @property
    def _on_the_ground(self) -> bool:
        """No vehicle can be armed yet: each agent waits for all others, and for the station."""
        waited_for = [*self._agents, *([self._station] if self._station is not None else ())]
        whole = len(self._agents) == len(self._setup.manifest.fleet) and self._station is not None
        return not whole or not all(child.ready for child in waited_for)

    def _stopped(self) -> bool:
        return self._interrupts.again

    def end(self) -> None:
        """Wind down: the agents, which land if they still fly, then the simulator, the station."""
        ground = self._on_the_ground
        stands_still = (
            ground and self._setup.options.lockstep is not None
        )  # its clock waits for all
        if not (self._interrupts.again or stands_still):
            speedup, stop = self._setup.options.speedup, self._stopped
            agents_s = _GROUND_WALL_S if ground else _AGENTS_S / speedup
            vehicles_s = _GROUND_WALL_S if ground else _SIMULATOR_WALL_S + _SIMULATOR_S / speedup
            self._let_agents_go()
            self._waiting.wait(self._agents, agents_s, "to bring the vehicles down", stop)
            self._wait_for_successors()
            providers = [c for c in (self._vehicles, self._simulator) if c is not None]
            for provider in providers:
                provider.let_go()
            until = "until all vehicles stand disarmed"
            self._waiting.wait(providers, vehicles_s, until, stop)
            if self._relay is not None:
                self._relay.let_go()
                wait_all([self._relay], _RELAY_WALL_S)
            if self._station is not None:
                self._station.say(finish=True)
                wait_all([self._station], _GROUND_WALL_S if ground else _STATION_WALL_S)
            router = self._router.child if self._router is not None else None
            for last in (self._keeper, router, *self._links):
                if last is not None:
                    last.let_go()
                    wait_all([last], _LINK_WALL_S if last in self._links else _RELAY_WALL_S)
        self._kill_all()

    def _wait_for_successors(self) -> None:
        """An agent that was killed and started again by hand lands later than the others, perhaps:
        its end is part of the run, and the station hears it."""
        speedup, folder = self._setup.options.speedup, self._setup.folder
        killed = [child.agent for child in self._agents if (child.exit_code() or 0) < 0]
        told, since_s = dict[int, float](), wall.wall_s()
        while killed and self._station_lives() and not self._interrupts.again:
            flying = flying_successors(folder, killed)
            if flying != told:
                told, since_s = flying, wall.wall_s()
            if not flying or wall.wall_s() - since_s > _SILENT_S / speedup:
                return
            whose = f"{agents_named(flying)}, taken over by another process, to land"
            self._waiting.tell(whose)
            wall.pause(_LOOK_WALL_S)

    def _kill_all(self) -> None:
        for child in self._children:
            child.kill()
        self._terminal.restore()

    def exit_codes(self) -> dict[str, int]:
        """Of all processes that the flight needs, by name; negative: the signal."""
        router = self._router.child if self._router is not None else None
        others = (self._relay, self._keeper, router)
        needed = [child for child in self._children if child not in others]
        codes = {child.name: child.exit_code() for child in needed}
        return {name: code for name, code in codes.items() if code is not None}


_MODES: Final = "?2004l ?1000l ?1003l ?1015l ?1006l ?1004l <u ?7h ?25h ?1049l 0m"
"""No pasting, no mouse, no focus reports, plain keys, wrapping, a cursor, the normal screen, plain
colours."""
_LEAVE: Final = "".join(f"\x1b[{mode}" for mode in _MODES.split()).encode()


class TerminalState:
    """The state of stdin's terminal when this was made; nothing where stdin is none. It is put
    back where a child that took it over can't do it any more."""

    def __init__(self) -> None:
        self._before: list[Any] | None = None
        with contextlib.suppress(OSError, ValueError, termios.error):
            self._before = termios.tcgetattr(sys.stdin.fileno())

    def restore(self) -> None:
        """Put it back, if it is in another mode now."""
        if self._before is None:
            return
        with contextlib.suppress(OSError, ValueError, termios.error):
            if termios.tcgetattr(sys.stdin.fileno()) != self._before:
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, self._before)
                os.write(sys.stdout.fileno(), _LEAVE)


EVERY_WALL_S: Final = 5.0
_WAITS_WALL_S: Final = 0.05


class Waiting:
    """Says what is waited for, each `EVERY_WALL_S` from the first call on, until that changes."""

    def __init__(
        self, say: Callable[[str], None], meanwhile: Callable[[], None] = lambda: None
    ) -> None:
        self._say = say
        self._meanwhile = meanwhile
        self._what = ""
        self._since_s = self._due_s = 0.0

    def tell(self, what: str) -> None:
        """Call it as often as you like; '' when there is nothing to wait for."""
        now = wall.wall_s()
        if what != self._what:
            self._what, self._since_s = what, now
            self._due_s = max(self._due_s, now + EVERY_WALL_S)
        if what and now >= self._due_s:
            self._due_s = now + EVERY_WALL_S
            self._say(f"waiting for {what}: {now - self._since_s:.0f} s so far")

    def wait(
        self,
        children: Sequence[Child],
        wall_seconds: float,
        until: str,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Wait until all have ended, at most so long, or until `stop`; `until`: what they do
        meanwhile."""
        end_s = wall.wall_s() + wall_seconds
        while wall.wall_s() < end_s and not stop() and (names := named(children)):
            self.tell(f"{names} {until}")
            self._meanwhile()
            wall.pause(_WAITS_WALL_S)
        self.tell("")


def named(children: Sequence[Child]) -> str:
    """Those that still run: `agents 1-3`, `the simulator`; '' if none does."""
    running = [child for child in children if child.exit_code() is None]
    agents = [child.agent for child in running if isinstance(child, AgentChild)]
    names = [agents_named(agents)] if agents else []
    names += [f"the {child.name}" for child in running if not isinstance(child, AgentChild)]
    return ", ".join(names)
