"""`swarm-ctl station`: one more ground station on a swarm that flies already."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from swarm_ctl.cli.shared.options import (
    Headless,
    IdentityFolder,
    Json,
    Metrics,
    OpenMesh,
    complete_runs,
    option,
)
from swarm_ctl.errors import InputError

_RUN: Final = "A run folder, or the mission of a run that flies.  [default: the one that flies]"
_MESH: Final = (
    "With --mission: where an agent listens; repeat it for each.  [default: as in its fleet]"
)


def station(
    run: Annotated[
        str | None, typer.Argument(metavar="RUN", help=_RUN, autocompletion=complete_runs)
    ] = None,
    mission: Annotated[
        Path | None, option("FILE", "A mission file instead of a run: for a swarm on other hosts.")
    ] = None,
    mesh: Annotated[list[str] | None, option("tcp/HOST:PORT", _MESH)] = None,
    fleet: Annotated[
        Path | None, option("FILE", "With --mission: the fleet file that is flown.")
    ] = None,
    speedup: Annotated[
        float | None,
        option("FACTOR", "With --mission: of the simulated swarm.", min=0.1, max=100.0),
    ] = None,
    identity: IdentityFolder = None,
    open_mesh: OpenMesh = False,
    headless: Headless = False,
    json: Json = False,
    metrics: Metrics = None,
) -> None:
    """Watch and command a swarm that flies already.

    From another terminal, the run folder is enough, or the mission's name; where one swarm alone
    flies, nothing is. From another host, give the mission file and
    the agents' mesh addresses: the station waits until it hears them. It shows agents that fly
    another plan, but can't send them a shape. Ctrl-C leaves; the swarm flies on.

    Examples:

    \b
        swarm-ctl station runs/20260101-120000-hexagon
        swarm-ctl station --mission missions/hexagon.yaml --fleet outdoors.yaml
        swarm-ctl station --mission pair.yaml --mesh tcp/10.0.0.11:7447
    """
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.runtime.flying_runs import flying_run
    from swarm_ctl.runtime.protection import Keys
    from swarm_ctl.runtime.station.join import join_run, join_swarm
    from swarm_ctl.runtime.station.screens import shown

    show = shown(headless=headless, json=json)
    if mission is None:
        for name, value in {"--mesh": mesh, "--fleet": fleet, "--speedup": speedup}.items():
            if value:
                raise InputError(f"{name} without a mission; allowed: together with --mission FILE")
        join_run(flying_run(run), show, metrics, identity)
    elif run is not None:
        raise InputError(f"both a run folder ({run}) and --mission {mission}; allowed: one of them")
    else:
        keys = Keys(identity, open_mesh, str(fleet or mission))
        join_swarm(load(mission, fleet=fleet), mesh or [], show, speedup or 1.0, metrics, keys)
