"""Who may offer a plan on a mesh with keys, with real zenoh sessions."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack, closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import SigningPolicy
from swarm_ctl.engine.fetched_plan import AgentPost, fetched_plan, kept_plan
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh.access import access_settings
from swarm_ctl.mesh.keys import plan_key
from swarm_ctl.mesh.zenoh_config import MeshPart
from swarm_ctl.mesh.zenoh_transport import Router, ZenohTransport
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.offers import PlanName, pack
from swarm_ctl.mission.compile.plan_file import named_by_hash
from swarm_ctl.trust import provision
from swarm_ctl.trust.identity import load_identity
from tests.system.running import HEXAGON

pytestmark = pytest.mark.realtime
MISSION = load(HEXAGON)
FORGED = replace(MISSION.plan, kappa=MISSION.plan.kappa / 2)
SWARM = MISSION.plan.name


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trust") / "field"
    hosts, terms = dict.fromkeys((1, 7), "127.0.0.1"), provision.Terms(datetime.now(UTC))
    provision.new(folder, "field", hosts, ["anna"], ["tv"], terms, ["127.0.0.1"])
    return folder


@pytest.mark.parametrize("routed", [False, True])
def test_an_operator_alone_offers_a_plan(field: Path, tmp_path: Path, *, routed: bool) -> None:
    """Agent 7 and a viewer, whose own zenoh lets everything through, offer a forged plan under the
    operator's key. By name alone, which takes no two plans, agent 1 gets the operator's."""
    at = f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"
    part = MeshPart.CLIENT if routed else MeshPart.PEER
    place = AgentPost((), (), at) if routed else AgentPost((at,), ())
    with ExitStack() as opened:
        if routed:
            keys = access_settings(load_identity(field / "router-1"), SWARM)
            opened.enter_context(closing(Router([at], [], access=keys)))
        for number, member in enumerate(("agent-7", "viewer-tv", "operator-anna")):
            access = access_settings(load_identity(field / member), SWARM)
            forger = member != "operator-anna"
            if forger:
                del access["access_control"]
            mesh = ZenohTransport([], [at], time.monotonic, access=access, part=part)
            opened.enter_context(closing(mesh))
            plan = FORGED if forger else MISSION.plan
            offer = pack(plan, MISSION.fleet.agents, SigningPolicy.OFF)
            mesh.serve(plan_key(SWARM, f"anna.{number}-a"), offer)
        identity = load_identity(field / "agent-1")
        found = fetched_plan(PlanName(SWARM), tmp_path, place, identity, 20.0)
    assert found.plan == MISSION.plan
    assert kept_plan(PlanName(*found.name.split("@")), tmp_path) == found
    assert kept_plan(PlanName(SWARM), tmp_path) is None


def test_on_an_open_mesh_the_hash_decides(tmp_path: Path) -> None:
    """Any process there offers what it likes: the forged plan is refused by its hash, and what was
    kept and changed since is not flown, either."""
    at = f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"
    name = named_by_hash(MISSION.plan, MISSION.fleet)
    named, place = PlanName(*name.split("@")), AgentPost((at,), ())
    with ExitStack() as opened:
        for name, plan in (("mallory", FORGED), ("anna", MISSION.plan)):
            mesh = opened.enter_context(closing(ZenohTransport([], [at], time.monotonic)))
            mesh.serve(plan_key(SWARM, name), pack(plan, MISSION.fleet.agents, SigningPolicy.OFF))
        assert fetched_plan(named, tmp_path, place, None, 20.0).plan == MISSION.plan
    [file] = tmp_path.iterdir()
    file.write_text(file.read_text().replace('"speed_mps"', '"speed_mps_"'))
    assert kept_plan(named, tmp_path) is None
