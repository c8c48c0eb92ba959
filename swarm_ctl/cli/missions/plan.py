"""`swarm-ctl plan`: a mission as data for the drones' computers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import FleetFile, MissionFile, option
from swarm_ctl.cli.shared.writable import require_writable


def plan(
    mission: MissionFile,
    fleet: FleetFile = None,
    out: Annotated[Path, option("FILE", "The plan file to write.")] = Path("plan.json"),
) -> None:
    """Write a mission as a plan file for the drones' computers.

    The plan file holds all that `swarm-ctl agent` needs: the checked mission with its slots dealt,
    a hash, and the fleet's endpoints. An agent that flies it needs only the core of swarm-ctl.

    Examples:

    \b
        swarm-ctl plan missions/square.yaml --fleet outdoors.yaml
        swarm-ctl plan missions/hexagon.yaml --out hexagon.json
    """
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.mission.compile.plan_file import named_by_hash, plan_to_json
    from swarm_ctl.runfolder.files import write_whole

    console = PlainConsole()
    loaded = load(mission, fleet=fleet)
    console.warn(loaded.warnings)
    require_writable(out, "choose with --out")
    write_whole(out, plan_to_json(loaded.plan, loaded.fleet))
    agents, name = len(loaded.plan.agents), named_by_hash(loaded.plan, loaded.fleet)
    console.say(f"plan: {out}, {agents} agents, {name}; swarm-ctl agent {out} --id ID")
