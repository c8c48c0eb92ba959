"""A whole run on this machine: starts simulator, agents and station, watches them, ends them, in
this order of care: vehicles come down first, then processes end, then the summary is written.
"""

from __future__ import annotations

import json
import platform
import socket
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

from swarm_ctl.errors import StartError
from swarm_ctl.mission.compile.fleet import Fleet, FleetAgent
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.mission.input.simulation_section import Simulation
from swarm_ctl.report.folder.manifest import Manifest, fingerprint, write_manifest
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary, write_summary
from swarm_ctl.runtime import clock as wall
from swarm_ctl.runtime.agent.agent_process import AgentConfig
from swarm_ctl.runtime.clock import Clock
from swarm_ctl.runtime.launch.interrupts import Interrupts
from swarm_ctl.runtime.launch.ports import free_ports
from swarm_ctl.runtime.launch.processes import (
    AgentChild,
    Child,
    CommandChild,
    simulator,
    station,
    wait_all,
)
from swarm_ctl.runtime.launch.sim_config import simulator_config
from swarm_ctl.runtime.launch.terminal_state import Terminal
from swarm_ctl.runtime.station.screens import Show

_START_WALL_S = 20.0
"""From the first process to the last `ready`; a loaded two-core machine needs 1 to 2 s."""
_POLL_WALL_S = 0.05
_LAND_WALL_S = 3.0
"""A land command that no agent has obeyed for this long (no station left to pass it on): cut the
lifelines instead."""
_HUNG_WALL_S = 20.0
"""An agent that has not said a word for this long is killed, so that a hung process can't hang the
run; its vehicle's failsafe has acted long before. Generous: an agent that is only suspended for a
while comes back by itself."""
_SIMULATOR_S = 100.0
"""The simulator itself waits 90 s for vehicles that still fly."""
_STATION_WALL_S = 10.0

PACKAGES = ("swarm-ctl", "eclipse-zenoh", "numpy", "pydantic", "pymavlink", "rich", "textual")


@dataclass(frozen=True, slots=True)
class Options:
    """How to run a mission."""

    speedup: float = 1.0
    show: Show = Show.DASHBOARD
    runs: Path = Path("runs")
    seed: int = 1
    record_hz: dict[str, float] = field(default_factory=dict)
    tlog: bool = True
    metrics_port: int | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """How a run ended. `interrupts`: how often Ctrl-C was pressed."""

    folder: Path
    summary: Summary
    interrupts: int


def fly(mission: LoadedMission, options: Options, say: Callable[[str], None]) -> Result:
    """Fly a mission to its end; StartError when something did not start (nothing is left running
    then)."""
    clock = Clock.starting_now(options.speedup)
    folder = run_folder(options.runs, mission.plan.name)
    manifest = _manifest(mission, options, clock)
    write_manifest(folder, manifest)
    with Interrupts() as interrupts:
        run = Run(folder, manifest, options, clock, interrupts)
        try:
            run.start(_simulated(mission.fleet), mission.file.simulation, say)
            run.watch(say)
        finally:
            run.end()
        codes = run.exit_codes()
        summary = summarise(folder, codes)
        try:
            write_summary(folder, summary)
        except OSError as error:  # a full disk: what was flown is told all the same
            say(f"the summary can't be written: {error.strerror}")
        return Result(folder, summary, interrupts.count)


class Run:
    """The processes of one run."""

    def __init__(
        self, folder: Path, manifest: Manifest, options: Options, clock: Clock, ctrl_c: Interrupts
    ) -> None:
        self._folder = folder
        self._manifest = manifest
        self._options = options
        self._clock = clock
        self._ctrl_c = ctrl_c
        self._simulator: CommandChild | None = None
        self._agents: list[AgentChild] = []
        self._station: CommandChild | None = None
        self._terminal = Terminal()

    @property
    def _children(self) -> list[Child]:
        return [
            child for child in (self._simulator, *self._agents, self._station) if child is not None
        ]

    def start(
        self, simulated: list[FleetAgent], simulation: Simulation, say: Callable[[str], None]
    ) -> None:
        """Start everything side by side and wait until all have said that they work."""
        folder, fleet = self._folder, self._manifest.fleet
        say(
            f"starting {'1 simulator, ' if simulated else ''}{len(fleet)} agents, 1 station; run folder {folder}"
        )
        try:
            if simulated:
                config = folder / "sim.json"
                endpoints = {agent.id: agent.endpoint for agent in fleet}
                vehicles = [replace(agent, endpoint=endpoints[agent.id]) for agent in simulated]
                config.write_text(
                    json.dumps(self._simulator_config(vehicles, simulation), indent=1)
                )
                self._simulator = simulator(config, folder / "simulator.log")
            (folder / "agents").mkdir()
            for index, agent in enumerate(fleet):
                self._agents.append(AgentChild(self._agent_config(index, agent)))
            self._station = station(
                folder, folder / "station.log", self._options.show, self._options.metrics_port
            )
            self._wait_ready()
        except BaseException:
            for child in self._children:  # nothing has armed yet
                child.kill()
            self._terminal.restore()
            raise
        (folder / "processes.json").write_text(
            json.dumps({child.name: child.pid for child in self._children})
        )

    def _wait_ready(self) -> None:
        until = wall.wall_s() + _START_WALL_S
        waiting = self._children
        while waiting:
            waiting = [child for child in waiting if not child.poll_ready()]
            if self._ctrl_c.count:
                raise KeyboardInterrupt
            if waiting and wall.wall_s() > until:
                names = ", ".join(child.name for child in waiting)
                raise StartError(
                    f"not ready after {_START_WALL_S:g} s: {names}; see the logs in {self._folder}"
                )
            wall.pause(0.01)

    def watch(self, say: Callable[[str], None]) -> None:
        """Until all agents have ended: pass Ctrl-C on, cut lifelines where nobody can, kill at the
        second Ctrl-C."""
        asked_s: float | None = None
        while any(agent.exit_code() is None for agent in self._agents):
            if self._ctrl_c.count > 1:
                return
            if self._ctrl_c.count and asked_s is None:
                asked_s = wall.wall_s()
                self._tell("landing the swarm; Ctrl-C again stops everything at once", say)
                self._ask_to_land()
            if (
                asked_s is not None
                and not self._can_command()
                and wall.wall_s() > asked_s + _LAND_WALL_S
            ):
                self._let_agents_go()
            for agent in self._agents:
                if agent.exit_code() is None and agent.silent_wall_s() > _HUNG_WALL_S:
                    self._tell(f"{agent.name} has hung for {_HUNG_WALL_S:g} s and is killed", say)
                    agent.kill()
            if not self._can_command():
                self._terminal.restore()  # a station that died can't: without it Ctrl-C would be a mere key
            wall.pause(_POLL_WALL_S)

    def _tell(self, text: str, say: Callable[[str], None]) -> None:
        """Say it where somebody looks: on the dashboard while that has the terminal."""
        if (
            self._options.show is not Show.DASHBOARD
            or self._station is None
            or not self._station.say(note=text)
        ):
            say(text)

    def _can_command(self) -> bool:
        return self._station is not None and self._station.exit_code() is None

    def _ask_to_land(self) -> None:
        if self._station is None or not self._station.say(command="land"):
            self._let_agents_go()

    def _let_agents_go(self) -> None:
        for agent in self._agents:
            agent.let_go()

    def end(self) -> None:
        """Wind down: agents (down already, or landing by themselves), the simulator, the
        station."""
        if self._ctrl_c.count > 1:
            for child in self._children:
                child.kill()
            self._terminal.restore()
            return
        scale = 1.0 / self._clock.speedup
        self._let_agents_go()
        wait_all([*self._agents], 200.0 * scale)
        if self._simulator is not None:
            self._simulator.let_go()
            wait_all([self._simulator], 5.0 + _SIMULATOR_S * scale)
        if self._station is not None:
            self._station.say(finish=True)
            wait_all([self._station], _STATION_WALL_S)
        for child in self._children:
            child.kill()
        self._terminal.restore()

    def exit_codes(self) -> dict[str, int]:
        """Of all processes, by name; negative: the signal."""
        return {
            child.name: code for child in self._children if (code := child.exit_code()) is not None
        }

    def _agent_config(self, index: int, agent: FleetAgent) -> AgentConfig:
        """Agent `index` listens for those after it and connects to those before it: every pair is
        linked once."""
        manifest = self._manifest
        return AgentConfig(
            plan=manifest.plan,
            agent_id=agent.id,
            sysid=agent.sysid,
            autopilot=agent.autopilot,
            endpoint=agent.endpoint or "",
            swarm=manifest.swarm,
            listen=agent.mesh or "",
            connect=tuple(other.mesh or "" for other in manifest.fleet[:index]),
            epoch_s=manifest.epoch_s,
            speedup=manifest.speedup,
            vehicle=agent.response,
            expect_station=True,
            report=self._folder / "agents" / f"{agent.id}.json",
            log=self._folder / "agents" / f"{agent.id}.log",
            tlog=self._folder / f"{agent.id}.tlog" if self._options.tlog else None,
            started_us=round(manifest.started_at.timestamp() * 1e6),
        )

    def _simulator_config(
        self, vehicles: list[FleetAgent], simulation: Simulation
    ) -> dict[str, Any]:
        return simulator_config(self._manifest.plan, vehicles, simulation) | {
            "speedup": self._manifest.speedup,
            "epoch_s": self._manifest.epoch_s,
            "seed": self._options.seed,
            "truth_path": str(self._folder / "truth.jsonl"),
        }


def run_folder(runs: Path, mission: str) -> Path:
    """Make `runs/<time>-<mission>`, with a number behind it where that is taken."""
    name = f"{wall.date_and_time():%Y%m%d-%H%M%S}-{mission}"
    for number in range(1, 1000):
        folder = runs / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise StartError(
                f"can't make the run folder {folder}: {error.strerror}; choose with --runs"
            ) from None
        return folder
    raise StartError(f"{runs} has a thousand folders {name}-*")


def _simulated(fleet: Fleet) -> list[FleetAgent]:
    return [agent for agent in fleet.agents if agent.endpoint is None]


def _manifest(mission: LoadedMission, options: Options, clock: Clock) -> Manifest:
    """The run's manifest, with every endpoint decided: simulated vehicles and mesh on free loopback
    ports."""
    vehicles = free_ports(len(_simulated(mission.fleet)), socket.SOCK_DGRAM)
    meshes = free_ports(
        sum(agent.mesh is None for agent in mission.fleet.agents) + 1, socket.SOCK_STREAM
    )
    fleet = tuple(
        replace(
            agent,
            endpoint=agent.endpoint or f"udpout:127.0.0.1:{vehicles.pop(0)}",
            mesh=agent.mesh or f"tcp/127.0.0.1:{meshes.pop(0)}",
        )
        for agent in mission.fleet.agents
    )
    return Manifest(
        mission=str(mission.source),
        swarm=mission.plan.name,
        started_at=wall.date_and_time(),
        speedup=options.speedup,
        epoch_s=clock.epoch_s,
        headless=options.show in (Show.LOG, Show.JSON),
        plan=mission.plan,
        plan_hash=fingerprint(mission.plan),
        fleet=fleet,
        station_mesh=f"tcp/127.0.0.1:{meshes.pop(0)}",
        record_hz=options.record_hz,
        versions={"python": platform.python_version()}
        | {name: metadata.version(name) for name in PACKAGES},
    )
