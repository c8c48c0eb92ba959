"""`swarm-ctl doctor` as a user calls it: what it refuses, what it says of this machine, and of a
vehicle that is not there."""

from __future__ import annotations

import json
import math
import os
import re
import socket
from datetime import UTC, datetime
from pathlib import Path

import pytest
import typer

from swarm_ctl.cli.checks.doctor import doctor
from swarm_ctl.cli.shared import machine as around
from swarm_ctl.core.model.vehicle import OwnParameters, OwnValue, VehicleIdentity
from swarm_ctl.cores import cores
from swarm_ctl.engine.vehicle_memory import VehicleMemory
from swarm_ctl.errors import InputError
from swarm_ctl.trust import provision
from swarm_ctl.trust.provision import Terms


def code_of(**arguments: object) -> int:
    with pytest.raises(typer.Exit) as ended:
        doctor(**arguments)  # type: ignore[arg-type]
    return ended.value.exit_code


def test_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Packages, autopilots with where to get them, and the vehicles that are remembered here."""
    for name in ("SWARM_CTL_ARDUCOPTER", "SWARM_CTL_PX4"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("SWARM_CTL_STATE", str(tmp_path))
    own = OwnParameters(VehicleIdentity("px4", 4, "ab"), {"COM_OBL_RC_ACT": OwnValue(0.0, (4.0,))})
    VehicleMemory(tmp_path).write(own, "udpin:127.0.0.1:14540", "20261122-hexagon")
    assert code_of(as_json=True) == 0
    facts = {f["name"]: f["state"] for f in json.loads(capsys.readouterr().out)["machine"]}
    assert "pymavlink 2" in facts["packages core"]
    assert facts["system"] == "linux, flies"
    assert facts["lockstep"] == "works here"
    assert re.match(
        r"\d+ cores, [\d.]+ GiB free: about \d+ agents in real time", facts["cores and memory"]
    )
    assert facts["browser"].startswith("none in the PATH")
    assert "git clone" in facts["arducopter program"]
    assert "git clone" in facts["px4 program"]
    assert facts["containers"] == "neither podman nor docker"
    assert facts["remembered vehicles"] == f"1 in {tmp_path}"
    assert (
        "own values COM_OBL_RC_ACT 0; left by 20261122-hexagon"
        in facts["  px4 4 at udpin:127.0.0.1:14540"]
    )


def test_a_port_that_is_taken_and_a_system_that_flies_nothing_are_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        monkeypatch.setattr(around, "_PORTS", ((socket.SOCK_DGRAM, port, "others"),))
        monkeypatch.setattr(around, "lacks", lambda: ["fork"])
        facts = {name: (state, attention) for name, state, attention in around.surroundings()}
    assert facts[f"port {port}"][0].startswith("in use (Address already in use), by others?")
    assert facts["system"][0].startswith("flies nothing: lacks fork; allowed: Linux")
    assert facts["system"][1]


def test_a_damaged_memory_needs_attention(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SWARM_CTL_STATE", str(tmp_path))
    (tmp_path / "px4-1-ab.json").write_text("{}")
    assert code_of() == 1
    assert "px4-1-ab.json: is no memory of a vehicle" in capsys.readouterr().out.replace("\n", "")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("agents: [{id: 1}]", "no vehicle has an endpoint"),
        ("agents: [{id: 1, endpoint: x, wrong: 2}]", "wrong"),
        ("agents: [{id: 1, endpoint: 'tcpin:0.0.0.0:5760'}]", "listens for its vehicle at tcpin"),
    ],
)
def test_refusals(tmp_path: Path, text: str, why: str) -> None:
    file = tmp_path / "fleet.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=why):
        doctor(fleet=file)
    with pytest.raises(InputError, match=re.escape("--restore needs vehicles")):
        doctor(restore=True)


def test_an_identity_asks_its_own_agent_s_vehicle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the keys of one agent, on its drone, the other vehicles' links could not be signed."""
    provision.new(
        tmp_path / "field", "field", {2: "127.0.0.1"}, ["anna"], [], Terms(datetime.now(UTC))
    )
    file = tmp_path / "fleet.yaml"
    file.write_text(
        "agents:\n"
        "  - {id: 1, endpoint: 'udpin:0.0.0.0:14601'}\n"
        "  - {id: 2, endpoint: 'udpin:0.0.0.0:14602'}\n"
    )
    assert code_of(fleet=file, identity=tmp_path / "field/agent-2", within=1.0) == 3
    told = capsys.readouterr().out
    assert "agent 2: sysid 2" in told
    assert "agent 1" not in told
    file.write_text("agents: [{id: 1, endpoint: 'udpin:127.0.0.1:14601'}]")
    with pytest.raises(InputError, match=r"is agent 2, which .* does not have; allowed: .* of 1"):
        doctor(fleet=file, identity=tmp_path / "field/agent-2")


def test_a_vehicle_that_does_not_answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 3 in the bounded time, with the reason; an endpoint that can't be opened, too."""
    file = tmp_path / "fleet.yaml"
    file.write_text(
        "agents:\n"
        "  - {id: 1, endpoint: 'tcp:127.0.0.1:9'}\n"
        "  - {id: 2, endpoint: 'serial:/dev/not-there', autopilot: px4}\n"
    )
    assert code_of(fleet=file, within=1.0) == 3
    told = capsys.readouterr().out
    assert "agent 1: sysid 1 at tcp:127.0.0.1:9, ardupilot: not reached" in told
    assert "no heartbeat yet from sysid 1" in told
    assert "/dev/not-there" in told


@pytest.mark.parametrize(
    ("quota", "share"), [("max 100000", math.inf), ("50000 100000", 1), ("100000 100000", 1)]
)
def test_a_container_has_as_many_cores_as_it_is_allowed(
    tmp_path: Path, quota: str, share: float
) -> None:
    """Some of a core is one; without a quota, or the file, all that this process may use."""
    (tmp_path / "cpu.max").write_text(quota + "\n")
    here = cores(tmp_path / "none")
    assert cores(tmp_path / "cpu.max") == min(share, here)
    assert 1 <= here <= (os.cpu_count() or 1)


@pytest.mark.parametrize(
    ("tick_s", "speedup", "most"),
    [(0.05, 1.0, 32), (0.1, 1.0, 64), (0.05, 4.0, 8), (0.05, 0.5, 64)],
)
def test_more_agents_than_the_machine_carries_by_the_wall_clock_are_warned_of(
    monkeypatch: pytest.MonkeyPatch, tick_s: float, speedup: float, most: int
) -> None:
    """On two cores: as many as it carries fly without a word; one more is told, with what would
    fly."""
    monkeypatch.setattr(around, "cores", lambda: 2)
    assert around.too_many(most, tick_s, speedup) == []
    (said,) = around.too_many(most + 1, tick_s, speedup)
    assert f"{most + 1} agents" in said
    assert f"about {most};" in said
    assert "--speedup max" in said
