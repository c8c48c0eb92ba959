"""`deploy` and `hosts` against real SSH servers, each a computer with a home of its own."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.hosts import computers
from tests.hosts.computers import Computer
from tests.system.running import SWARM_CTL

pytestmark = pytest.mark.skipif(bool(computers.why_not()), reason=computers.why_not() or "-")

MISSION = """
version: 1
name: {name}
origin: {{lat_deg: 47.4, lon_deg: 8.5, alt_m: 400}}
lengths: metres
prepare_timeout_s: 40
law: {{r: 60, r_out: 7, r_in: 2.5}}
agents: [{agents}]
shapes:
  row: {{kind: offsets, offsets: [{offsets}]}}
steps:
  - takeoff: {{height_m: 5}}
  - form: {{shape: row, timeout_s: 60}}
  - move: {{by: [8, 0], timeout_s: 60}}
  - land
"""


class Swarm:
    """A mission, its computers, and the operator who deploys it."""

    def __init__(self, where: Path, machines: Sequence[Computer], inside: Sequence[str]) -> None:
        self.where, self._inside = where, inside
        self.computers = {machine.name: machine for machine in machines}
        self._config = computers.ssh_config(where, self.computers)
        self.said = ""

    def __call__(self, *words: str | Path, wall_s: float = 90) -> int:
        """Run swarm-ctl as the operator does; the exit code. What it says is `said`."""
        line = [*self._inside, str(SWARM_CTL), *map(str, words)]
        if words[0] in ("deploy", "hosts"):
            line += ["--ssh-config", str(self._config)]
        done = subprocess.run(
            line, cwd=self.where, capture_output=True, text=True, timeout=wall_s, check=False
        )
        self.said = done.stdout + done.stderr
        sys.stdout.write(
            f"$ swarm-ctl {' '.join(map(str, words))}\n{self.said}= {done.returncode}\n"
        )
        return done.returncode

    def wait_for(self, host: str, state: str, wall_s: float = 60) -> None:
        """Until all agents of a host are in this state, as the host itself says."""
        until = time.monotonic() + wall_s
        while True:
            line = [str(self.computers[host].home / "login")]
            env = os.environ | {"SSH_ORIGINAL_COMMAND": ".local/bin/swarm-ctl on-host state"}
            done = subprocess.run(line, env=env, capture_output=True, text=True, check=True)
            services = json.loads(done.stdout)["services"]
            if services and all(each["state"] == state for each in services):
                return
            assert time.monotonic() < until, done.stdout
            time.sleep(0.3)


def mission(where: Path, fleet: Sequence[str], name: str = "outdoors") -> Path:
    """A mission of one agent a host, and its fleet beside it."""
    places = {k: f"[0, {9 * k}]" for k in range(1, len(fleet) + 1)}
    agents = ", ".join(f"{{id: {k}, start: {place}}}" for k, place in places.items())
    path = where / f"{name}.yaml"
    rows = "".join(f"    - {row}\n" for row in fleet)
    path.write_text(
        MISSION.format(name=name, agents=agents, offsets=", ".join(places.values()))
        + f"fleet:\n  agents:\n{rows}"
    )
    return path


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Swarm]:
    """Two computers on this machine's loopback."""
    keys = computers.made_keys(tmp_path)
    machines = [
        Computer(f"drone{k}", keys, tmp_path, "127.0.0.1", computers.free_port(), ())
        for k in (1, 2)
    ]
    swarm = Swarm(tmp_path, machines, ())
    try:
        yield swarm
    finally:
        for machine in machines:
            machine.switch_off()
            for file in machine.root.glob("pids/*.json"):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(json.loads(file.read_text())[0], signal.SIGKILL)


@pytest.mark.timeout(90)
def test_two_computers(here: Swarm) -> None:
    """One that is off is waited for, and nothing starts before; then the bundles are there, the
    agents run; a second time nothing changes; another plan waits for the operator's word; stop
    ends the agents, and their logs come back."""
    first, second = here.computers.values()
    ports = [computers.free_port() for _ in range(4)]
    rows = [
        f"{{id: {k}, host: drone{k}, endpoint: 'udpout:127.0.0.1:{ports[k]}',"
        f" mesh: tcp/127.0.0.1:{ports[k + 1]}}}"
        for k in (1, 2)
    ]
    file = mission(here.where, rows)
    first.switch_on()
    assert here("deploy", file, "--wait", "0") == 3
    assert "nothing was started: drone2" in here.said
    assert not (first.root / "current").exists()
    second.switch_on()
    assert here("deploy", file) == 0
    assert "drone1: has bundle" in here.said
    assert "drone1: agent-1 started" in here.said
    assert here("deploy", file) == 0
    assert "drone2: agent-2 runs already" in here.said
    file.write_text(file.read_text().replace("[8, 0]", "[9, 0]"))
    assert here("deploy", file) == 1
    assert "agent-1: runs with plan" in here.said
    assert "--restart lands it first" in here.said
    assert here("hosts", "stop", file) == 0
    assert here("hosts", "collect", file) == 0
    logs = {path.name for path in (here.where / "collected/drone1").glob("*/*")}
    assert logs >= {"agent-1.log", "agent-1.json", "agent-1.tlog"}
