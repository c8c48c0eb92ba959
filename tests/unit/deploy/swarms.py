"""A swarm of three agents on two hosts, with keys and without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from swarm_ctl.core.model.fleet import Fleet, SigningPolicy
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine.clock import date_and_time
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.mission.compile.plan_file import named_by_hash
from swarm_ctl.trust import provision
from swarm_ctl.trust.provision import Terms
from tests.unit.mission.example import TEXT

HOSTS = ("drone1", "drone1", "drone2")


def plan() -> Plan:
    return loads(TEXT).plan


def fleet(trust: Path | None = None, endpoint: str = "") -> Fleet:
    loaded = loads(TEXT).fleet.agents
    agents = tuple(
        replace(
            agent,
            host=host,
            endpoint=endpoint or f"udpout:127.0.0.1:{14600 + agent.id}",
            mesh=f"tcp/127.0.0.1:{7440 + agent.id}",
        )
        for agent, host in zip(loaded, HOSTS, strict=True)
    )
    if trust is None:
        return Fleet(agents)
    return Fleet(agents, str(trust), SigningPolicy.REQUIRED)


def whole_hash() -> str:
    """Of plan, fleet and signing."""
    return named_by_hash(plan(), fleet()).rpartition("@")[2]


def keys(folder: Path) -> Path:
    """A trust folder of the swarm."""
    hosts = {agent.id: "127.0.0.1" for agent in fleet().agents}
    provision.new(folder, "outdoors", hosts, ["anna"], [], Terms(date_and_time()))
    return folder
