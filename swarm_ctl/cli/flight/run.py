"""`swarm-ctl run`: fly a mission from one terminal."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    Attach,
    FleetFile,
    Headless,
    IdentityFolder,
    Json,
    MissionFile,
    OpenMesh,
    VehicleKinds,
    ZenohConfig,
    attaching,
    gcs_addresses,
    option,
    switch,
    zenoh_settings,
)
from swarm_ctl.cli.shared.result import exit_code, show_summary
from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.errors import InputError

if TYPE_CHECKING:
    from swarm_ctl.engine.interrupts import Interrupts
    from swarm_ctl.engine.script import RunScript
    from swarm_ctl.mission.compile.loader import LoadedMission
    from swarm_ctl.report.judge.summary import Summary

_ARDUCOPTER: Final = (
    "The ArduCopter SITL binary, or container:IMAGE for one in a container of podman or docker."
    "  [default: $SWARM_CTL_ARDUCOPTER, or the PATH]"
)
_PX4: Final = "PX4's build folder, with bin/px4 and etc/.  [default: $SWARM_CTL_PX4, or the PATH]"
_PX4_LOG: Final = "Let each PX4 write its own log (ULog), 15 MB a minute."
_GCS: Final = (
    "Send all vehicles to the ground control software there (QGroundControl, MAVProxy), and its"
    " frames to them; repeat it for another.  [14550 where no port follows]"
)
_RECORD: Final = (
    "Record at most so many messages a second of a topic, per agent, e.g. state=5,truth=2."
    "  [default: all]"
)
_SPEEDUP: Final = (
    "Mission seconds per second of the wall clock, 0.1 to 100; max: in lockstep, as fast as it"
    " goes.  [default: 1; in lockstep: max]"
)
_LOCKSTEP: Final = (
    "Mission time waits for every process: a busy machine makes a slow run, and no other one. The"
    " same seed gives the same flight."
)
_SEED: Final = "Seed of all random numbers.  [default: 1; of a scenario: its own]"
_PATIENCE_S: Final = 10.0
_PATIENCE: Final = (
    "In lockstep, go on without a process that has been stopped for so long."
    f"  [default: {_PATIENCE_S:g}]"
)
_WITH: Final = "In lockstep, do not start before this member has joined, too."
_LIFELINE: Final = (
    "For a program that starts this: the number of an open pipe. When its other end is closed, the"
    " program is gone, and the swarm lands."
)
_JUNIT: Final = (
    "Write the result as JUnit XML, too: a test case a step, one for the distance, one for the"
    " verdict."
)


@attaching
def run(
    mission: MissionFile,
    speedup: Annotated[str | None, option("FACTOR|max", _SPEEDUP)] = None,
    headless: Headless = False,
    json: Json = False,
    attach: Attach = None,
    fleet: FleetFile = None,
    vehicles: VehicleKinds = None,
    arducopter: Annotated[str | None, option("PATH|container:IMAGE", _ARDUCOPTER)] = None,
    px4: Annotated[str | None, option("FOLDER", _PX4)] = None,
    px4_log: Annotated[bool, switch("--px4-log", _PX4_LOG)] = False,
    identity: IdentityFolder = None,
    open_mesh: OpenMesh = False,
    zenoh_config: ZenohConfig = None,
    runs: Annotated[Path, option("FOLDER", "Where the run's folder is made.")] = Path("runs"),
    gcs: Annotated[list[str] | None, option("[HOST:]PORT", _GCS)] = None,
    seed: Annotated[int | None, option("NUMBER", _SEED, min=0)] = None,
    lockstep: Annotated[bool, switch("--lockstep", _LOCKSTEP)] = False,
    patience: Annotated[
        float | None, option("SECONDS", _PATIENCE, "--lockstep-patience", min=1.0, max=3600.0)
    ] = None,
    lockstep_with: Annotated[list[str] | None, option("NAME", _WITH)] = None,
    lifeline: Annotated[int | None, option("NUMBER", _LIFELINE, min=3)] = None,
    record_hz: Annotated[str, option("TOPIC=HZ,...", _RECORD)] = "",
    report: Annotated[bool, typer.Option(help="Make the report at the end.")] = True,
    junit: Annotated[Path | None, option("FILE", _JUNIT)] = None,
    tlog: Annotated[bool, typer.Option(help="Record each vehicle's MAVLink frames.")] = True,
) -> None:
    """Fly a mission, or a scenario, on this machine.

    Starts the agents, a ground station, and the vehicles that have no endpoint: simulated ones, or
    with --vehicles the autopilots themselves (SITL), each at its agent's start.
    A scenario, a file that names a mission and all that befalls it, flies in lockstep.
    Ctrl-C lands the swarm and waits for it, and so do SIGTERM and a closed terminal; a second
    Ctrl-C stops all processes at once.

    Exit codes: 0 completed, 1 mission failed, 2 bad input, 3 something did not start, 130 ended by
    Ctrl-C, SIGTERM or a closed terminal.

    Examples:

    \b
        swarm-ctl run missions/hexagon.yaml
        swarm-ctl run missions/hexagon.yaml --speedup 5 --headless
        swarm-ctl run missions/hexagon.yaml --speedup max --headless --seed 7
        swarm-ctl run missions/hexagon.yaml --json | jq .error_m
        swarm-ctl run missions/hexagon.yaml --vehicles arducopter,px4
        swarm-ctl run missions/hexagon.yaml --foxglove 8765
        swarm-ctl run missions/hexagon.yaml --ros2
        swarm-ctl run scenario.yaml --headless
    """
    from swarm_ctl.cli.shared.machine import too_many
    from swarm_ctl.engine.launch.run_setup import Lockstep, RunOptions
    from swarm_ctl.engine.launch.supervisor import fly
    from swarm_ctl.engine.protection import Keys
    from swarm_ctl.engine.station.screens import Show, shown
    from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.mission.fleet.fleet_file import file_of
    from swarm_ctl.virtual.scenario_file import is_scenario

    factor = _factor(speedup)
    stepped, scripted = None, is_scenario(mission)
    if lockstep or scripted or speedup == "max":
        stepped = Lockstep(factor, patience or _PATIENCE_S, tuple(lockstep_with or ()))
    elif patience is not None or lockstep_with:
        name = "--lockstep-with" if lockstep_with else "--lockstep-patience"
        raise InputError(f"{name}: this run is in real time; allowed: beside --lockstep")
    show = shown(headless=headless, json=json)
    console = PlainConsole(stderr=json)
    if show is Show.DASHBOARD and not console.is_terminal:
        show = Show.LOG
    script = None
    if scripted:
        _refuse_beside_a_scenario(
            mission, {"--seed": seed, "--fleet": fleet, "--vehicles": vehicles}
        )
        loaded, script, seed = _scenario(mission)
    else:
        loaded = load(mission, fleet=fleet, vehicles=vehicles)
    console.warn(loaded.warnings)
    if stepped is None:
        console.warn(too_many(len(loaded.plan.agents), loaded.plan.tick_s, factor or 1.0))
    guarded = open_mesh or loaded.fleet.trust is not None
    own = zenoh_settings(zenoh_config, guarded=guarded)
    refuse_too_close(loaded, forecast(loaded.plan))

    def say(text: str) -> None:
        with contextlib.suppress(OSError):  # the reader of our output is gone; the swarm flies on
            console.say(text)

    binaries = {VehicleKind.ARDUCOPTER: arducopter, VehicleKind.PX4: px4}
    options = RunOptions(
        speedup=1.0 if script is not None else factor or 1.0,  # what it says is in mission time
        show=show,
        runs=runs,
        seed=1 if seed is None else seed,
        record_hz=_rates(record_hz),
        tlog=tlog,
        attach=tuple(attach or ()),
        gcs=gcs_addresses(gcs or ()),
        binaries=binaries,
        px4_log=px4_log,
        lockstep=stepped,
        keys=Keys(identity, open_mesh, str(fleet or file_of(mission) or mission), own),
        script=script,
        lifeline=lifeline,
    )
    if lifeline is not None and not _is_pipe(lifeline):
        raise InputError(f"--lifeline {lifeline}: is no pipe; allowed: the reading end of one")
    free = junit is None or (junit.parent.is_dir() and os.access(junit.parent, os.W_OK))
    if junit is not None and (junit.is_dir() or not free):
        raise InputError(f"--junit {junit}: can't be written; allowed: a file in a folder that may")
    started = {agent.started_as for agent in loaded.fleet.agents}
    for name, kind, given in (
        ("--arducopter", VehicleKind.ARDUCOPTER, arducopter),
        ("--px4", VehicleKind.PX4, px4),
        ("--px4-log", VehicleKind.PX4, px4_log),
    ):
        if given and kind not in started:
            raise InputError(f"{name}: no {kind} flies here; allowed: beside --vehicles {kind}")
    out = sys.stderr if json else sys.stdout

    def show_result(folder: Path, summary: Summary, interrupts: Interrupts) -> None:
        show_summary(console, folder, summary, out if report else None, interrupts)
        if junit is not None:
            _write_junit(junit, summary, console)

    result = fly(loaded, options, say, show_result)
    raise typer.Exit(exit_code(result.summary, result.interrupts))


def _is_pipe(number: int) -> bool:
    try:
        return stat.S_ISFIFO(os.fstat(number).st_mode)
    except OSError:  # nothing is open there
        return False


def _refuse_beside_a_scenario(path: Path, options: dict[str, Any]) -> None:
    for name, given in options.items():
        if given is not None:
            raise InputError(
                f"{name} {given}: {path} is a scenario, which says that itself; allowed: its seed,"
                " and the fleet of its mission"
            )


def _scenario(path: Path) -> tuple[LoadedMission, RunScript, int]:
    """The mission, what befalls it, and the seed."""
    from swarm_ctl.virtual.as_processes import run_script
    from swarm_ctl.virtual.scenario import load_scenario

    scenario, loaded = load_scenario(path)
    try:
        return loaded, run_script(scenario, loaded.plan), scenario.seed
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _factor(speedup: str | None) -> float | None:
    """None: as fast as it goes, or not given. InputError for what is no factor."""
    if speedup in (None, "max"):
        return None
    try:
        factor = float(speedup or "")
    except ValueError:
        factor = 0.0
    if not 0.1 <= factor <= 100.0:
        raise InputError(f"--speedup {speedup}; allowed: 0.1 to 100, or max")
    return factor


def _rates(words: str) -> dict[str, float]:
    """Of `--record-hz`. What says them takes a tenth of the start, and few ask for it."""
    if not words:
        return {}
    from swarm_ctl.recording.topics import rates

    return rates(words)


def _write_junit(path: Path, summary: Summary, console: PlainConsole) -> None:
    from swarm_ctl.report.page.junit import junit
    from swarm_ctl.runfolder.files import write_whole

    try:
        write_whole(path, junit(summary))
    except OSError as error:  # the result stands
        console.say(f"{path} can't be written: {error.strerror}")
