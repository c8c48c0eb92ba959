"""`swarm-ctl agent`: one agent alone, the same that `run` starts six of."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.fleet import Fleet, FleetAgent
from swarm_ctl.mission.compile.loader import load


def agent(
    mission: Annotated[Path, typer.Argument(help="The mission file.")],
    agent_id: Annotated[
        int, typer.Option("--id", help="Which agent of the mission this process is.")
    ],
    fleet: Annotated[
        Path | None, typer.Option(help="A fleet file: endpoints of vehicles and mesh.")
    ] = None,
    speedup: Annotated[
        float, typer.Option(min=0.1, max=100.0, help="For simulated vehicles at the same factor.")
    ] = 1.0,
    epoch: Annotated[
        float | None,
        typer.Option(
            help="Zero of the mission clock on this host's monotonic clock; default: now."
        ),
    ] = None,
) -> None:
    """Fly one agent. Its fleet entry must name `endpoint` (the vehicle) and `mesh` (where this
    agent listens).

    Ctrl-C lands its vehicle.

    Example:

        swarm-ctl agent missions/hexagon.yaml --fleet outdoors.yaml --id 3
    """
    from swarm_ctl.runtime.agent.agent_process import AgentConfig, run_agent
    from swarm_ctl.runtime.agent.lifeline import SignalLifeline
    from swarm_ctl.runtime.clock import Clock

    loaded = load(mission, fleet=fleet)
    own, before = _own(loaded.fleet, agent_id)
    config = AgentConfig(
        plan=loaded.plan,
        agent_id=agent_id,
        sysid=own.sysid,
        autopilot=own.autopilot,
        endpoint=own.endpoint or "",
        swarm=loaded.plan.name,
        listen=own.mesh or "",
        connect=tuple(other.mesh for other in before if other.mesh),
        epoch_s=Clock.starting_now().epoch_s if epoch is None else epoch,
        speedup=speedup,
        vehicle=own.response,
    )
    raise typer.Exit(run_agent(config, SignalLifeline()))


def _own(fleet: Fleet, agent_id: int) -> tuple[FleetAgent, tuple[FleetAgent, ...]]:
    """The agent's fleet entry and those before it, which it connects to."""
    ids = [entry.id for entry in fleet.agents]
    if agent_id not in ids:
        raise InputError(
            f"--id {agent_id} is no agent of this mission; allowed: {', '.join(map(str, ids))}"
        )
    own = fleet.agent(agent_id)
    for field in ("endpoint", "mesh"):
        if not getattr(own, field):
            raise InputError(
                f"agent {agent_id} has no `{field}` in the fleet; a single agent needs one"
            )
    return own, fleet.agents[: ids.index(agent_id)]
