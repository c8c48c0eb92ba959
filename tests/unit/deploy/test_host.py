"""The host's side: atomic, once at a time, and never against an agent that runs."""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.core.model.fleet import Fleet
from swarm_ctl.deploy import host as host_module
from swarm_ctl.deploy.bundle import Bundle, Service, bundles_of
from swarm_ctl.deploy.host import Host
from swarm_ctl.deploy.report import ReportedState
from swarm_ctl.deploy.services import Plain, Systemd, units_of
from swarm_ctl.errors import InputError, StartError
from tests.unit.deploy.swarms import fleet, keys, plan, whole_hash


class Scripted:
    """Services that run as they are told."""

    name = "scripted"

    def __init__(self) -> None:
        self.running: set[str] = set()
        self.calls: list[str] = []
        self.lands = True
        self.units: Mapping[str, str] = {}

    def install(self, units: Mapping[str, str]) -> None:
        self.units = units
        self.calls += [f"install {name}" for name in units]

    def start(self, service: Service) -> None:
        self.calls.append(f"start {service.name}")
        self.running.add(service.name)

    def interrupt(self, service: Service) -> None:
        self.calls.append(f"interrupt {service.name}")
        if self.lands:
            self.running.discard(service.name)

    def runs(self, service: Service) -> bool:
        return service.name in self.running


@pytest.fixture
def host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Host:
    monkeypatch.setattr(host_module, "_EARLY_S", 0.0)
    program = tmp_path / "swarm-ctl"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    made = Host(tmp_path / "home")
    made.services = Scripted()
    return made


def scripted(host: Host) -> Scripted:
    assert isinstance(host.services, Scripted)
    return host.services


def bundle(endpoint: str = "") -> Bundle:
    return bundles_of(plan(), fleet(endpoint=endpoint))["drone1"]


def test_a_bundle_that_is_taken_in_changes_nothing_yet(host: Host) -> None:
    host.install(bundle())
    report = host.report()
    assert (report.next, report.current, report.running) == (bundle().digest, "", ())
    host.start(bundle().digest)
    report = host.report()
    assert report.current == bundle().digest
    assert report.whole_hash == whole_hash()
    assert report.running == ("agent-1", "agent-2")
    assert scripted(host).calls == [
        "install swarm-ctl-agent@.service",
        "start agent-1",
        "start agent-2",
    ]


def test_units_are_made_here_of_the_manifest(host: Host) -> None:
    """Whatever lies in the bundle's folder: a unit starts swarm-ctl alone."""
    host.install(bundle())
    evil = host.root / "bundles" / bundle().digest / "swarm-ctl-agent@.service"
    evil.write_text("[Service]\nExecStartPre=/bin/sh -c evil\n")
    host.start()
    assert dict(scripted(host).units) == units_of(bundle().manifest)
    (unit,) = scripted(host).units.values()
    started = [line for line in unit.split("\n") if line.startswith(("Exec", "Environment"))]
    program = "%h/.local/share/swarm-ctl/host"
    command = f"{program}/bin/swarm-ctl agent {program}/current/plan.json --id %i"
    assert started == [f"ExecStart={command} --record {program}/flight"]


def test_a_start_by_hand_that_fails_ends_so(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the agents' own words. `deploy`, which names the bundle, reads them in the answer."""

    def fails(service: Service) -> None:
        (host.root / "flight" / f"{service.name}.log").write_text("error: no such port\n")

    host.install(bundle())
    monkeypatch.setattr(host.services, "start", fails)
    monkeypatch.setattr("swarm_ctl.cli.hosts.on_host._host", lambda: host)
    deployed = CliRunner().invoke(app, ["on-host", "start", "--bundle", bundle().digest])
    assert (deployed.exit_code, deployed.output.count('"failed"')) == (0, 2)
    typed = CliRunner().invoke(app, ["on-host", "start"])
    assert isinstance(typed.exception, StartError)
    words = "error: no such port"
    assert str(typed.exception) == f"agent-1: {words}; agent-2: {words}"


def test_no_bundle_takes_the_place_of_one_that_flies(host: Host) -> None:
    """It stays as it is until its agents have landed; then only the new one is left."""
    host.install(bundle())
    host.start()
    other = bundle("serial:/dev/ttyACM0")
    host.install(other)
    with pytest.raises(InputError, match=r"agent-1, agent-2 of plan \w+: runs; .*--restart"):
        host.start(other.digest)
    assert host.report().current == bundle().digest
    host.stop(1.0)
    host.start(other.digest)
    assert host.report().current == other.digest
    assert [path.name for path in (host.root / "bundles").iterdir()] == [other.digest]


def test_an_agent_that_has_ended_starts_beside_one_that_runs(host: Host) -> None:
    """In the flight's own folder: the logs of one flight stay together."""
    host.install(bundle())
    host.start()
    flight = (host.root / "flight").readlink()
    scripted(host).running.discard("agent-2")
    scripted(host).calls.clear()
    host.start()
    assert scripted(host).calls == ["start agent-2"]
    assert (host.root / "flight").readlink() == flight


def test_only_the_bundle_that_was_meant_starts(host: Host) -> None:
    with pytest.raises(InputError, match="no bundle was taken in here"):
        host.start()
    host.install(bundle())
    with pytest.raises(InputError, match=f"bundle {bundle().digest} is here, not {'0' * 12}"):
        host.start("0" * 12)


def test_an_agent_that_does_not_land_is_not_killed(host: Host) -> None:
    host.install(bundle())
    host.start()
    scripted(host).lands = False
    with pytest.raises(StartError, match=r"agent-1, agent-2: still runs .* is not killed"):
        host.stop(0.1)
    assert host.report().running == ("agent-1", "agent-2")


def test_the_router_ends_after_the_agents(host: Host) -> None:
    agents = tuple(replace(a, router=f"tcp/10.0.0.{a.id // 3}:7447") for a in fleet().agents)
    host.install(bundles_of(plan(), Fleet(agents))["drone1"])
    host.start()
    host.stop(1.0)
    order = ["router", "agent-1", "agent-2"]
    assert scripted(host).calls[-6:-3] == [f"start {name}" for name in order]
    assert scripted(host).calls[-3:] == [f"interrupt {n}" for n in (*order[1:], order[0])]


def test_keys_are_their_users_alone(host: Host, tmp_path: Path) -> None:
    """They end in the host's trust folder; the copy that came is gone."""
    made = bundles_of(plan(), fleet(keys(tmp_path / "outdoors")))["drone1"]
    host.install(made)
    host.start()
    trust = host.root / "trust/outdoors"
    assert {path.name for path in trust.iterdir()} == {"agent-1", "agent-2"}
    assert list((host.root / "bundles").rglob("*.bundle")) == []
    for path in host.root.rglob("*.key"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    words = [word for s in made.manifest.services(str(host.root)) for word in s.words]
    assert words.count("--identity") == 2
    assert f"{trust}/agent-2" in words


def test_what_an_autopilot_needs_is_looked_at(host: Host, tmp_path: Path) -> None:
    missing = tmp_path / "ttyACM0"
    host.install(bundle(f"serial:{missing}:115200"))
    assert f"{missing} is not there: is the autopilot on, and plugged in?" in (
        host.report().attention
    )


def test_how_a_process_stands_is_in_its_flight(host: Host) -> None:
    """Running, ended by its own word, failed with what it said last, stopped."""
    host.install(bundle())
    host.start()
    scripted(host).running.discard("agent-2")
    (host.root / "flight/agent-2.log").write_text("agent: ready\nerror: no port\n")
    states = {each.name: (each.state, each.said) for each in host.report().services}
    assert states["agent-1"] == (ReportedState.RUNNING, "")
    assert states["agent-2"] == (ReportedState.FAILED, "error: no port")


def test_a_process_without_systemd_outlives_its_starter(tmp_path: Path) -> None:
    """It is known by pid and start, so a number that was given again is no agent; SIGINT ends
    it."""
    (tmp_path / "flight").mkdir()
    service = Service("agent-1", "", ("/bin/sh", "-c", "echo here; exec sleep 30"))
    plain = Plain(tmp_path)
    assert not plain.runs(service)
    plain.start(service)
    assert plain.runs(service)
    pids = tmp_path / "pids/agent-1.json"
    kept = pids.read_text()
    pids.write_text(kept.replace(' "', ' "1'))
    assert not plain.runs(service), "another process has its number"
    pids.write_text(kept)
    log = tmp_path / "flight/agent-1.log"
    while not log.read_text():  # SIGINT before that ends the shell, and it says nothing
        time.sleep(0.01)
    plain.interrupt(service)
    os.waitpid(int(kept.strip("[").partition(",")[0]), 0)
    assert not plain.runs(service)
    assert log.read_text() == "here\n"


_SYSTEMCTL = """#!/bin/sh
echo "$@" >> {log}
case "$*" in
    *show*) cat {state};;
    *daemon-reload*) exit {reload};;
esac
"""


def test_systemd_is_asked_as_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Units are where its manager reads them; an error names what the user needs."""
    log, state = tmp_path / "log", tmp_path / "state"
    state.write_text("inactive\n")
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    root = tmp_path / "home/.local/share/swarm-ctl/host"
    units = {"swarm-ctl-agent@.service": "[Unit]\n"}
    for reload in (0, 1):
        script = tmp_path / "systemctl"
        script.write_text(_SYSTEMCTL.format(log=log, state=state, reload=reload))
        script.chmod(0o755)
        if reload:
            with pytest.raises(StartError, match="loginctl enable-linger"):
                Systemd(root).install(units)
            return
        manager = Systemd(root)
        manager.install(units)
        written = tmp_path / "home/.config/systemd/user/swarm-ctl-agent@.service"
        assert written.read_text() == "[Unit]\n"
        service = Service("agent-1", "swarm-ctl-agent@1.service", ())
        manager.start(service)
        state.write_text("deactivating\n")
        assert manager.runs(service), "it lands"
        manager.interrupt(service)
        asked = log.read_text().split("\n")
        assert "--user start swarm-ctl-agent@1.service" in asked
        assert "--user stop --no-block swarm-ctl-agent@1.service" in asked
