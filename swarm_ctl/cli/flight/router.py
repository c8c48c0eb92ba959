"""`swarm-ctl router`: the router of a host, for a swarm whose agents are started by hand."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated, Final

import typer

from swarm_ctl.cli.flight.agent import plan_and_fleet
from swarm_ctl.cli.shared.options import (
    FleetFile,
    OpenMesh,
    Speedup,
    ZenohConfig,
    option,
    zenoh_settings,
)
from swarm_ctl.errors import InputError

_LISTEN: Final = "Where it listens: a `router` of the fleet.  [default: the fleet's only one]"
_PLAN: Final = (
    "A plan file, a mission file (needs ground), or the swarm's name alone with --listen."
)
_CONNECT: Final = "Of a name alone: where another host's router listens; repeat it."
_IDENTITY: Final = (
    "The folder with its own keys (swarm-ctl trust).  [default: as in the fleet's trust]"
)


def router(
    file: Annotated[Path, typer.Argument(metavar="PLAN", help=_PLAN)],
    listen: Annotated[str | None, option("tcp/HOST:PORT", _LISTEN)] = None,
    connect: Annotated[list[str] | None, option("tcp/HOST:PORT", _CONNECT)] = None,
    fleet: FleetFile = None,
    speedup: Speedup = 1.0,
    identity: Annotated[Path | None, option("FOLDER", _IDENTITY)] = None,
    open_mesh: OpenMesh = False,
    zenoh_config: ZenohConfig = None,
) -> None:
    """Pass on what a swarm says, on its host.

    For a swarm of more than 16 agents, or whose fleet names routers: one for each host, started
    before its agents; `run` starts its own. It connects to the fleet's other routers. Ctrl-C ends
    it when its last client has gone; a second one at once. It needs no plan: where agents fetch
    theirs, the mission's name and the routers' places are enough.

    Examples:

    \b
        swarm-ctl router plan.json
        swarm-ctl router plan.json --listen tcp/192.168.1.11:7447
        swarm-ctl router hexagon --listen tcp/10.0.0.12:7447
    """
    from swarm_ctl.engine.lifeline import ALIVE, READY, SignalLifeline
    from swarm_ctl.engine.protection import router_identity_folder
    from swarm_ctl.engine.router.router_process import RouterConfig, run_router
    from swarm_ctl.mesh.access import as_tls
    from swarm_ctl.mission.fleet.exposure import leaves_loopback, refuse_exposed
    from swarm_ctl.signals import ENDED_CODE

    swarm, trust, at, others = _told(file, fleet, listen, connect or [])
    keys = identity or router_identity_folder(trust, at)
    if keys is None and not open_mesh:
        exposed = [f"a router is at {each}" for each in (at, *others) if leaves_loopback(each)]
        refuse_exposed(exposed, str(fleet or file))
    spelled = as_tls if keys is not None else str

    class Lifeline(SignalLifeline):
        """A second Ctrl-C does not wait."""

        def _signalled(self, number: int, frame: object) -> None:
            if self._cut and number == signal.SIGINT:
                raise SystemExit(ENDED_CODE)
            super()._signalled(number, frame)
            sys.stderr.write("router: ends with its last client; Ctrl-C again: at once\n")

        def tell(self, text: str) -> None:
            self._alive()
            if text == READY:
                sys.stderr.write(f"router: listens at {spelled(at)}\n")
            elif text != ALIVE:
                sys.stderr.write(f"router: {text}\n")

    before = tuple(map(spelled, others))
    own = zenoh_settings(zenoh_config, guarded=open_mesh or keys is not None)
    config = RouterConfig(swarm, spelled(at), before, speedup, identity=keys, zenoh=own)
    raise typer.Exit(run_router(config, Lifeline()))


def _told(
    file: Path, fleet: Path | None, listen: str | None, connect: list[str]
) -> tuple[str, str | None, str, tuple[str, ...]]:
    """The swarm, its fleet's trust, where the router listens, and the routers it connects to."""
    from swarm_ctl.core.swarm.hearing import hears_all
    from swarm_ctl.mission.compile.offers import plan_name

    named = None if file.exists() else plan_name(str(file))
    if named is not None:
        if listen is None or fleet is not None:
            raise InputError(f"{file} is no file; allowed: a swarm's name with --listen alone")
        return named.name, None, listen, tuple(connect)
    if connect:
        raise InputError(f"--connect: {file} has the routers; allowed: with a swarm's name alone")
    plan, entries = plan_and_fleet(file, fleet)
    if hears_all(plan) and not entries.routers:
        raise InputError(
            f"{file}: a swarm of {len(plan.agents)} agents is a mesh of peers; allowed: 17 and"
            " more, or a fleet that names a `router`"
        )
    return plan.name, entries.trust, *_endpoints(entries.routers, listen)


def _endpoints(routers: tuple[str, ...], listen: str | None) -> tuple[str, tuple[str, ...]]:
    """Where it listens, and the routers before it in the fleet: of two, one has to connect."""
    if listen is None and len(routers) == 1:
        listen = routers[0]
    if listen is None or listen not in routers:
        what = f"--listen {listen}: is no router of the fleet" if listen else "which router?"
        raise InputError(
            f"{what}; allowed: --listen with one of"
            f" {', '.join(routers) or 'the fleet, which names none (`router`)'}"
        )
    return listen, routers[: routers.index(listen)]
