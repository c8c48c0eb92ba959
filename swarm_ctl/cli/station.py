"""`swarm-ctl station`: one more ground station on a swarm that flies already."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import load


def station(
    run: Annotated[
        Path | None, typer.Argument(help="The run folder; default: the newest in runs/.")
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option(help="A mission file instead of a run folder: for a swarm on other hosts."),
    ] = None,
    mesh: Annotated[
        list[str] | None,
        typer.Option(
            help="With --mission: where an agent listens, tcp/HOST:PORT; once for each. Default: its fleet."
        ),
    ] = None,
    fleet: Annotated[
        Path | None, typer.Option(help="With --mission: the fleet file that is flown with.")
    ] = None,
    speedup: Annotated[
        float | None,
        typer.Option(min=0.1, max=100.0, help="With --mission: that of a simulated swarm."),
    ] = None,
    headless: Annotated[
        bool, typer.Option("--headless", help="Plain log lines instead of the dashboard.")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="One line of JSON a second on stdout.")
    ] = False,
    metrics: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Prometheus metrics on this port of 127.0.0.1."),
    ] = None,
) -> None:
    """Watch and command a swarm from another terminal, or from another host. Ctrl-C leaves it; the
    swarm flies on.

    A run of this machine is found by its folder. Anywhere else the mission file is enough, with the
    endpoints of the agents: the station waits until they are heard; agents that fly another plan
    are shown, and take no shapes from it.

    Examples:

        swarm-ctl station runs/20260101-120000-hexagon

        swarm-ctl station --mission missions/hexagon.yaml --fleet outdoors.yaml

        swarm-ctl station --mission pair.yaml --mesh tcp/10.0.0.11:7447 --mesh tcp/10.0.0.12:7447
    """
    from swarm_ctl.runtime.station.join import join_run, join_swarm
    from swarm_ctl.runtime.station.screens import shown

    show = shown(headless=headless, json=json)
    if mission is None:
        _refuse_without_mission({"--mesh": mesh, "--fleet": fleet, "--speedup": speedup})
        folder = run if run is not None else newest_run(Path("runs"))
        join_run(folder, show, metrics)
        return
    if run is not None:
        raise InputError(f"both a run folder ({run}) and --mission {mission}; allowed: one of them")
    join_swarm(load(mission, fleet=fleet), mesh or [], show, speedup or 1.0, metrics)


def _refuse_without_mission(options: dict[str, object]) -> None:
    for name, value in options.items():
        if value:
            raise InputError(
                f"{name} says where a mission is flown; allowed: together with --mission FILE"
            )


def newest_run(runs: Path) -> Path:
    """The newest run folder in `runs`."""
    folders = [path.parent for path in runs.glob("*/run.json")]
    if not folders:
        raise InputError(f"no run in {runs}/; name a run folder")
    return max(folders)
