"""`swarm-ctl station`: one more ground station on a swarm that flies already."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from swarm_ctl.cli.flight.agent import plan_and_fleet
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    Attach,
    FlownFleet,
    Headless,
    IdentityFolder,
    Json,
    OpenMesh,
    SwarmElsewhereFile,
    ZenohConfig,
    attaching,
    complete_runs,
    option,
    without,
    zenoh_settings,
)
from swarm_ctl.cli.shared.result import exit_code, show_summary
from swarm_ctl.errors import InputError, StartError

if TYPE_CHECKING:
    from swarm_ctl.engine.station.join import SwarmElsewhere
    from swarm_ctl.engine.station.screens import Show

_RUN: Final = "A run folder, or the mission of a run that flies.  [default: the one that flies]"
_RUNS: Final = (
    "With --mission: fly the swarm from here. Record into a new folder in this one, land the swarm"
    " at Ctrl-C, end with it, and judge it as `run` does."
)
_TRUTH: Final = (
    "With --runs: what `sim --truth` writes on this computer. The run is judged by it, and gets a"
    " copy.  [default: judged by the vehicles' own estimates]"
)
_WEB_DASHBOARD: Final = (
    "Serve the dashboard to web browsers on this port of 127.0.0.1, instead of this terminal. Who"
    " has the link commands. Needs the extra `web`.  [8701 where no port follows]"
)
_MESH: Final = (
    "With --mission: where an agent listens; repeat it for each.  [default: as in its fleet]"
)


@attaching
def station(
    run: Annotated[
        str | None, typer.Argument(metavar="RUN", help=_RUN, autocompletion=complete_runs)
    ] = None,
    mission: SwarmElsewhereFile = None,
    mesh: Annotated[list[str] | None, option("tcp/HOST:PORT", _MESH)] = None,
    fleet: FlownFleet = None,
    speedup: Annotated[
        float | None,
        option("FACTOR", "With --mission: of the simulated swarm.", min=0.1, max=100.0),
    ] = None,
    runs: Annotated[Path | None, option("FOLDER", _RUNS)] = None,
    truth: Annotated[Path | None, option("FILE", _TRUTH)] = None,
    identity: IdentityFolder = None,
    open_mesh: OpenMesh = False,
    zenoh_config: ZenohConfig = None,
    headless: Headless = False,
    json: Json = False,
    attach: Attach = None,
    web_dashboard: Annotated[int | None, option("PORT", _WEB_DASHBOARD, min=1, max=65535)] = None,
) -> None:
    """Watch and command a swarm that flies already.

    From another terminal, give the run folder or the mission's name, or neither if only one swarm
    flies. From another host, give the mission or plan file and the agents' mesh addresses: the
    station waits until it hears them. It shows agents that fly another plan, but can't send them a
    shape. Ctrl-C leaves; the swarm flies on. Without a dashboard it ends with the run.

    With --runs it is the flight's own station, as that of `run`: agents that were started with
    --expect-station wait for it, and its exit code is the mission's (0 completed, 1 failed, 130
    ended by Ctrl-C, SIGTERM or a closed terminal).

    Examples:

    \b
        swarm-ctl station runs/20260101-120000-hexagon
        swarm-ctl station hexagon --foxglove 8765
        swarm-ctl station hexagon --ros2
        swarm-ctl station --mission missions/hexagon.yaml --fleet outdoors.yaml
        swarm-ctl station --mission plan.json --mesh tcp/10.0.0.11:7447
        swarm-ctl station --mission square.yaml --fleet outdoors.yaml --runs runs
    """
    from swarm_ctl.engine.flying_runs import flying_run
    from swarm_ctl.engine.protection import Keys
    from swarm_ctl.engine.station.join import elsewhere, join_run, join_swarm
    from swarm_ctl.engine.station.screens import shown
    from swarm_ctl.extension import check
    from swarm_ctl.runfolder.manifest import read_manifest

    show = shown(headless=headless, json=json)
    attached = attach or []
    check(attached)
    if web_dashboard is not None:
        for name, given in {
            "--headless": headless,
            "--json": json,
            "--runs": runs,
            "an extension": attached,
        }.items():
            if given:
                raise InputError(f"--web-dashboard with {name}; allowed: one of them")
        if mission is None:
            flying_run(run)
        _serve_dashboard(web_dashboard)
        return
    if mission is None:
        for name, value in {
            "--mesh": mesh,
            "--fleet": fleet,
            "--speedup": speedup,
            "--runs": runs,
            "--truth": truth,
        }.items():
            if value:
                raise InputError(f"{name} without a mission; allowed: together with --mission FILE")
        folder = flying_run(run)
        own = zenoh_settings(zenoh_config, guarded=open_mesh or read_manifest(folder).guarded)
        join_run(folder, show, attached, Keys(identity, zenoh=own))
    elif run is not None:
        raise InputError(f"both a run folder ({run}) and --mission {mission}; allowed: one of them")
    else:
        if truth is not None and runs is None:
            raise InputError(f"--truth {truth} without a run; allowed: together with --runs FOLDER")
        plan, entries = plan_and_fleet(mission, fleet)
        guarded = open_mesh or bool(identity or entries.trust)
        own = zenoh_settings(zenoh_config, guarded=guarded)
        keys = Keys(identity, open_mesh, str(fleet or mission), own)
        swarm = elsewhere(plan, entries, mission, mesh or [], speedup or 1.0, keys)
        if runs is None:
            join_swarm(swarm, show, attached)
        else:
            raise typer.Exit(_judge(swarm, runs, truth, show, attached))


def _serve_dashboard(port: int) -> None:
    from swarm_ctl.engine.local_server import refuse_taken

    try:
        from swarm_ctl.engine.station.served_dashboard import DashboardServer
    except ModuleNotFoundError as error:
        raise StartError(
            f"--web-dashboard needs {error.name}, which is not installed; install with: pip install"
            " 'swarm-ctl[web]'"
        ) from None
    refuse_taken(port, "web-dashboard")
    words = sys.argv[sys.argv.index("station") + 1 :]
    server = DashboardServer(without(words, "--web-dashboard"), port)
    PlainConsole().say(f"the dashboard, for whoever may command: {server.link}  (Ctrl-C ends it)")
    server.serve()


def _judge(
    swarm: SwarmElsewhere, runs: Path, truth: Path | None, show: Show, attach: list[str]
) -> int:
    """Fly the swarm from here; the exit code."""
    from swarm_ctl.engine.interrupts import Interrupts
    from swarm_ctl.engine.lifeline import sign_of_life
    from swarm_ctl.engine.station.judged_flight import judge_swarm
    from swarm_ctl.engine.station.screens import Show
    from swarm_ctl.signals import ENDED_CODE

    console = PlainConsole(stderr=show is Show.JSON)
    with Interrupts() as interrupts:
        result = judge_swarm(swarm, runs, show, attach, sign_of_life(), interrupts, truth)
        if result is None:
            console.say("no agent was heard: nothing was recorded")
            return ENDED_CODE
        out = sys.stderr if show is Show.JSON else sys.stdout
        show_summary(console, result.folder, result.summary, out, interrupts)
    return exit_code(result.summary, result.interrupts)
