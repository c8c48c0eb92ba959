"""The processes that `run` forks. Each is told the run's folder and its number among its kind, and
reads the rest there."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.fleet import Fleet, SigningPolicy
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.engine.agent.agent_process import AgentConfig, run_agent
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.launch_file import read_launch
from swarm_ctl.engine.lifeline import Lifeline
from swarm_ctl.engine.lockstep.seat import SLOW
from swarm_ctl.engine.protection import router_identity_folder
from swarm_ctl.engine.radio.link_process import LinkConfig, run_link
from swarm_ctl.engine.router.router_process import RouterConfig, run_router
from swarm_ctl.engine.script import NO_SCRIPT
from swarm_ctl.engine.vehicle_memory import state_folder
from swarm_ctl.errors import StartError
from swarm_ctl.runfolder.manifest import read_manifest

_LARGE_SWARM_NICE: Final = 4
"""Where both cores are busy, an agent then gets 0.4 of what a process that serves all gets (Linux:
1.25 a step). Chosen, not measured."""


def agent(folder: Path, number: int, lifeline: Lifeline) -> int:
    """Fly this agent. Of a large swarm, whose processes one machine hardly carries, those that
    serve all agents (simulator, router, station) come first."""
    config = _agent_config(folder, number)
    if not hears_all(config.plan):
        os.nice(_LARGE_SWARM_NICE)
    return run_agent(config, lifeline)


def _agent_config(folder: Path, number: int) -> AgentConfig:
    manifest, launch = read_manifest(folder), read_launch(folder)
    fleet = Fleet(manifest.fleet, manifest.trust, manifest.signing)
    clock = Clock(manifest.epoch_s, manifest.speedup)
    config = AgentConfig.of(manifest.plan, fleet, number, clock)
    scripts = {} if launch.script is None else launch.script.agents
    apart = {i for i, script in scripts.items() if script.clock is not None}
    together = tuple(a.id for a in manifest.fleet if a.id not in apart)
    return replace(
        config,
        expect_station=True,
        report=folder / "agents" / f"{number}.json",
        tlog=folder / f"{number}.tlog" if launch.tlog else None,
        memory=state_folder() if number in launch.remembered else None,
        flight=folder.name,
        mirror=launch.relay.mirror_of(number) if launch.relay else None,
        lockstep=manifest.lockstep,
        signing=SigningPolicy.OFF if number in launch.autopilots else manifest.signing,
        same_clock=() if number in apart else together,
        script=scripts.get(number, NO_SCRIPT),
        zenoh=manifest.zenoh,
        started_us=round(manifest.started_at.timestamp() * 1e6),
    )


def router(folder: Path, _: int, lifeline: Lifeline) -> int:
    """Be the router of a run that has one."""
    manifest = read_manifest(folder)
    listen = manifest.fleet[0].router
    if listen is None:
        raise StartError(f"{folder}: is the run of a mesh of peers")
    config = RouterConfig(
        manifest.swarm,
        listen,
        speedup=manifest.speedup if manifest.lockstep is None else SLOW,
        patient=manifest.lockstep is not None,
        identity=router_identity_folder(manifest.trust, listen),
        zenoh=manifest.zenoh,
    )
    return run_router(config, lifeline)


def link(folder: Path, number: int, lifeline: Lifeline) -> int:
    """Serve the radio with this number, from 1 on, of those that agents share."""
    manifest = read_manifest(folder)
    agents = list(Fleet(manifest.fleet).radios().values())[number - 1]
    return run_link(LinkConfig(agents, manifest.signing is SigningPolicy.REQUIRED), lifeline)
