"""`swarm-ctl agent`: one agent alone, the same that `run` starts six of."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final

import typer

from swarm_ctl.cli.shared.extras import require
from swarm_ctl.cli.shared.options import FleetFile, OpenMesh, Speedup, option
from swarm_ctl.core.model.fleet import Fleet, FleetAgent, Signing
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError, TrustError

_PEER: Final = (
    "Where another agent listens; repeat it. Of two agents, one has to name the other."
    "  [default: the agents before it in the fleet]"
)
_KEY: Final = (
    "The vehicle's 32-byte signing key, mode 0600: all frames are signed. The newest stamp is kept"
    " beside it.  [default: as in the fleet]"
)
_IDENTITY: Final = (
    "The folder with its own keys (swarm-ctl trust).  [default: agent-ID in the fleet's trust]"
)
_LOCKSTEP: Final = "The folder of a run in lockstep, whose clock this agent joins."


def agent(
    file: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A plan file, or a mission file (needs ground).")
    ],
    agent_id: Annotated[int, option("ID", "The agent that this process is.", "--id")],
    endpoint: Annotated[
        str | None,
        option("URL", "Its vehicle, e.g. serial:/dev/ttyAMA0:921600.  [default: as in the fleet]"),
    ] = None,
    mesh: Annotated[
        str | None, option("tcp/HOST:PORT", "Where it listens.  [default: as in the fleet]")
    ] = None,
    peer: Annotated[list[str] | None, option("tcp/HOST:PORT", _PEER)] = None,
    fleet: FleetFile = None,
    speedup: Speedup = 1.0,
    epoch: Annotated[
        float | None,
        option("SECONDS", "Mission time 0 on this host's monotonic clock.  [default: now]"),
    ] = None,
    identity: Annotated[Path | None, option("FOLDER", _IDENTITY)] = None,
    open_mesh: OpenMesh = False,
    lockstep: Annotated[Path | None, option("RUN", _LOCKSTEP)] = None,
    signing_key: Annotated[Path | None, option("FILE", _KEY)] = None,
) -> None:
    """Fly one agent, on the computer of its drone.

    The vehicle's endpoint and the address on the mesh are in the file's fleet, or given here. The
    agents need no ground station. Ctrl-C lands the vehicle.

    Examples:

    \b
        swarm-ctl agent plan.json --id 3
        swarm-ctl agent plan.json --id 3 --endpoint serial:/dev/ttyAMA0:921600
        swarm-ctl agent missions/hexagon.yaml --fleet outdoors.yaml --id 3
    """
    from swarm_ctl.mission.compile.exposure import exposures, refuse_exposed
    from swarm_ctl.runtime.agent.agent_process import AgentConfig, run_agent
    from swarm_ctl.runtime.clock import Clock
    from swarm_ctl.runtime.lifeline import SignalLifeline
    from swarm_ctl.runtime.protection import agent_identity_folder
    from swarm_ctl.runtime.vehicle_memory import state_folder

    plan, entries = _plan(file, fleet)
    own, before = _own(entries, agent_id, endpoint, mesh)
    keys = agent_identity_folder(entries.trust, agent_id, identity)
    connect = tuple(peer or (other.mesh for other in before if other.mesh))
    signing = Signing.REQUIRED if signing_key else entries.signing
    if not open_mesh:
        exposed = exposures(Fleet((own,), None if keys is None else str(keys), signing), connect)
        refuse_exposed(exposed, str(fleet or file), keys)
    config = AgentConfig(
        plan=plan,
        agent_id=agent_id,
        sysid=own.sysid,
        agent_sysid=own.agent_sysid,
        autopilot=own.autopilot,
        endpoint=own.endpoint or "",
        swarm=plan.name,
        listen=own.mesh or "",
        connect=connect,
        epoch_s=Clock.starting_now().epoch_s if epoch is None else epoch,
        speedup=speedup,
        vehicle=own.response,
        memory=state_folder(),
        flight=plan.name,
        lockstep=None if lockstep is None else _clock_of(lockstep),
        signing_key=signing_key,
        identity=keys,
        signing=entries.signing,
    )
    if keys is not None:
        threading.Thread(target=_explain, args=(keys, connect), daemon=True).start()
    raise typer.Exit(run_agent(config, SignalLifeline()))


def _explain(keys: Path, peers: Sequence[str]) -> None:
    """Say why a peer that is there already refuses this agent, which goes on trying: in the air it
    must not wait for the answer."""
    from swarm_ctl.runtime.protection import explained
    from swarm_ctl.trust.identity import load_identity

    with contextlib.suppress(TrustError):  # `run_agent` says it
        why = explained(load_identity(keys), peers)
        if why:
            sys.stderr.write(f"agent: {why}\n")


def _clock_of(run: Path) -> str:
    from swarm_ctl.report.folder.manifest import read_manifest

    found = read_manifest(run).lockstep
    if found is None:
        raise InputError(f"--lockstep {run}: that run is in real time; allowed: one in lockstep")
    return found


def _plan(file: Path, fleet: Path | None) -> tuple[Plan, Fleet]:
    from swarm_ctl.mission.compile.plan_file import is_plan_file, read_plan

    if not is_plan_file(file):
        require("ground", f"{file} is a mission file, which")
        from swarm_ctl.mission.compile.loader import load

        loaded = load(file, fleet=fleet)
        return loaded.plan, loaded.fleet
    if fleet is not None:
        raise InputError(
            f"--fleet {fleet}: {file} is a plan file and has its fleet; allowed: --endpoint, --mesh"
        )
    found = read_plan(file)
    return found.plan, Fleet(found.fleet, found.trust, found.signing)


def _own(
    fleet: Fleet, agent_id: int, endpoint: str | None, mesh: str | None
) -> tuple[FleetAgent, tuple[FleetAgent, ...]]:
    """The agent's fleet entry with the addresses that were given, and the entries before it."""
    ids = [entry.id for entry in fleet.agents]
    if agent_id not in ids:
        allowed = ", ".join(map(str, ids))
        raise InputError(f"--id {agent_id} is no agent of this mission; allowed: {allowed}")
    entry = fleet.agent(agent_id)
    own = replace(entry, endpoint=endpoint or entry.endpoint, mesh=mesh or entry.mesh)
    for name, value in {"endpoint": own.endpoint, "mesh": own.mesh}.items():
        if not value:
            raise InputError(
                f"agent {agent_id} has no `{name}` in the fleet; a single agent needs one,"
                f" there or as --{name}"
            )
    return own, fleet.agents[: ids.index(agent_id)]
