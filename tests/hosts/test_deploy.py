"""`deploy` and `hosts` against real SSH servers, each a computer with a home of its own."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.hosts import computers, namespaces
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
        self.rows: list[str] = []
        """Of the fleet."""

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

    def sh(self, host: str, line: str) -> str:
        """What a person who has logged in there gets for this line."""
        login = [*self._inside, "ssh", "-F", str(self._config), host]
        done = subprocess.run(
            [*login, f"PATH=$HOME/.local/bin:$PATH {line}"],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def wait_for(self, host: str, state: str, wall_s: float = 60) -> None:
        """Until all agents of a host are in this state, as the host itself says."""
        until = time.monotonic() + wall_s
        while True:
            said = self.sh(host, "swarm-ctl on-host state")
            services = json.loads(said)["services"]
            if services and all(each["state"] == state for each in services):
                return
            assert time.monotonic() < until, said
            time.sleep(0.3)

    @contextlib.contextmanager
    def simulator(self, file: Path) -> Iterator[Truth]:
        """The fleet's vehicles, where the operator is."""
        truth = Truth(self.where / "truth.jsonl")
        line = [*self._inside, str(SWARM_CTL), "sim", "--mission", str(file), "--open-mesh"]
        for at in re.findall("udpout:([0-9.:]+)", file.read_text()):
            line += ["--endpoint", f"udpin:{at}"]
        with (
            (self.where / "sim.log").open("wb") as log,
            subprocess.Popen(
                [*line, "--truth", str(truth.path)], stdout=log, stderr=log, cwd=self.where
            ) as process,
        ):
            try:
                yield truth
            finally:
                process.kill()


class Truth:
    """Where the vehicles are, as the simulator writes it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def flying(self) -> int:
        """How many vehicles are in the air now."""
        lines = self.path.read_bytes().split(b"\n")[:-1]
        state = next(line for line in reversed(lines) if b'"state"' in line)
        return sum(json.loads(state)["airborne"])

    def wait_flying(self, count: int, wall_s: float = 90) -> None:
        """Until so many vehicles are in the air."""
        until = time.monotonic() + wall_s
        while self.flying() != count:
            assert time.monotonic() < until, self.flying()
            time.sleep(0.2)


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


@pytest.mark.long
@pytest.mark.timeout(200)
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


@pytest.fixture
def six(tmp_path: Path) -> Iterator[Swarm]:
    """Six computers in network namespaces of their own, with a process table of their own: what
    runs there ends with the power. The operator is in the middle, where their vehicles are."""
    if namespaces.why_not():
        pytest.skip(namespaces.why_not())
    keys = computers.made_keys(tmp_path)
    apart = ("unshare", "--pid", "--mount", "--mount-proc", "--fork", "--kill-child")
    with namespaces.Network(6) as network, contextlib.ExitStack() as switches:
        machines = [
            Computer(
                f"drone{side + 1}",
                keys,
                tmp_path,
                f"{network.middle_address(side)[:-1]}2",
                22,
                namespace.inside(apart),
            )
            for side, namespace in enumerate(network.sides)
        ]
        for machine in machines:
            switches.callback(machine.switch_off)
        swarm = Swarm(tmp_path, machines, network.middle.inside([]))
        swarm.rows = [
            f"{{id: {k + 1}, host: drone{k + 1}, mesh: tcp/{network.address(k)}:7447,"
            f" endpoint: 'udpout:{network.middle_address(k)}:{14600 + k}'}}"
            for k in range(6)
        ]
        yield swarm


@pytest.mark.long
@pytest.mark.timeout(600)
def test_six_companion_computers(six: Swarm) -> None:
    """From an empty folder, as the guide says: keys; a computer that is off is waited for, and
    then all six fly. One loses its power in the air: its vehicle lands by itself, the others land
    as their policy says. It comes back with nothing running; a plan of another hash that it got by
    stick is shown, and keeps all six on the ground. Deployed once more, they fly to the end, and
    their logs come home."""
    file = mission(six.where, six.rows)
    assert six("trust", "new", "--fleet", file) == 0
    file.write_text(file.read_text() + '  trust: trust/outdoors\n  signing: "off"\n')
    last = six.computers["drone6"]
    for machine in six.computers.values():
        if machine is not last:
            machine.switch_on()
    with six.simulator(file) as truth:
        booting = threading.Timer(6.0, last.switch_on)
        booting.start()
        assert six("deploy", file) == 0
        booting.join()
        assert "drone6: got bundle" in six.said
        assert six.said.index("drone6: got bundle") < six.said.index("drone1: agent-1 started")
        assert six("hosts", "status", file) == 0
        truth.wait_flying(6)

        third = six.computers["drone3"]
        third.switch_off()
        assert six("hosts", "status", file) == 3
        assert "drone3" in six.said
        for host in six.computers:
            if host != "drone3":
                six.wait_for(host, "failed")  # policies.agent_lost: land
        truth.wait_flying(0)

        third.switch_on()
        assert six("hosts", "status", file) == 1
        assert "drone3: agent-3" in six.said

        other = mission(six.where, six.rows, "other")
        other.write_text(
            other.read_text().replace("[8, 0]", "[9, 0]").replace("name: other", "name: outdoors")
            + '  trust: trust/outdoors\n  signing: "off"\n'
        )
        assert six("deploy", other, "--bundles", six.where / "stick") == 0
        six.sh("drone3", f"swarm-ctl on-host install {six.where}/stick/drone3.tar")
        for host in six.computers:
            six.sh(host, "swarm-ctl on-host start")
        assert six("hosts", "status", file, "--plan", file) == 1
        assert "drone3: has plan" in six.said
        for host in six.computers:
            six.wait_for(host, "failed", 90)  # prepare_timeout_s
        assert truth.flying() == 0
        assert six("hosts", "status", file) == 1
        assert "agent 3 has another plan" in six.said

        assert six("deploy", file) == 0
        assert "drone1: has bundle" in six.said
        assert "drone3: got bundle" in six.said
        for host in six.computers:
            six.wait_for(host, "ended", 120)
    assert six("hosts", "collect", file) == 0
    for k, host in enumerate(six.computers, start=1):
        logs = {path.name for path in (six.where / f"collected/{host}").glob("*/*")}
        assert logs == {f"agent-{k}.log", f"agent-{k}.json", f"agent-{k}.tlog"}


@pytest.mark.long
@pytest.mark.timeout(200)
def test_each_host_has_its_router(here: Swarm) -> None:
    """It is started before its agent, and ends after it."""
    ports = [computers.free_port() for _ in range(4)]
    rows = [
        f"{{id: {k}, host: drone{k}, endpoint: 'udpout:127.0.0.1:{ports[k]}',"
        f" router: tcp/127.0.0.1:{ports[k + 1]}}}"
        for k in (1, 2)
    ]
    file = mission(here.where, rows)
    for machine in here.computers.values():
        machine.switch_on()
    assert here("deploy", file) == 0
    assert "drone1: router started\ndrone1: agent-1 started\n" in here.said
    assert "drone2  0.2.0" in here.said
    assert here("hosts", "status", file) == 0
    assert here("hosts", "stop", file) == 0
    assert "router stopped, agent-2 ended" in here.said
