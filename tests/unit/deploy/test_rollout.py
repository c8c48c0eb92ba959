"""All hosts have their bundle, or none starts; and what ssh is told."""

from __future__ import annotations

import os
import shlex
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import pytest

from swarm_ctl import __version__
from swarm_ctl.cli.hosts.hosts import _whole_hash, common_plan, exit_code, show_hosts
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.deploy import rollout
from swarm_ctl.deploy.bundle import Bundle, bundles_of
from swarm_ctl.deploy.report import HostReport, ReportedState, ServiceReport
from swarm_ctl.deploy.rollout import Hosts, HostState, parted
from swarm_ctl.deploy.ssh import Reach, Ssh, SshResult
from swarm_ctl.errors import StartError
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.plan_file import plan_to_json
from tests.unit.deploy.swarms import fleet, plan, whole_hash
from tests.unit.mission.example import TEXT

OLD = "0123456789abcdef"


class Script:
    """Hosts that answer as they are told: drone1 is fine, drone2 is as `report` says, after ssh has
    not found it `offline` times."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, *, offline: int = 0, **report: object
    ) -> None:
        self.calls: list[tuple[str, str]] = []
        self._offline, self._report = offline, report
        monkeypatch.setattr(rollout, "_AGAIN_S", 0.01)
        monkeypatch.setattr(Ssh, "ask", lambda _, host, words, *__: self._answer(host, words))

    def _answer(self, host: str, words: Sequence[str]) -> SshResult:
        self.calls.append((host, words[0]))
        report: dict[str, object] = {"version": __version__, "manager": "systemd"}
        if host == "drone2":
            self._offline -= 1
            if self._offline >= 0:
                return SshResult(Reach.OFFLINE, words="No route to host")
            report |= self._report
        return SshResult(
            Reach.ANSWERED, HostReport.model_validate(report).model_dump_json().encode()
        )


def brought(wait_s: float = 60, *, restart: bool = False) -> tuple[dict[str, HostState], list[str]]:
    """How the hosts stand when their bundles were brought, and what was told meanwhile."""
    told: list[str] = []

    def tell(host: str, words: str) -> None:
        told.append(f"{host}: {words}")

    made = bundles()
    return Hosts(Ssh(), made).bring(made, wait_s, tell, restart=restart), told


def bundles() -> dict[str, Bundle]:
    return bundles_of(plan(), fleet())


def running(whole_hash: str = OLD, current: str = "") -> dict[str, object]:
    service = ServiceReport(name="agent-3", state=ReportedState.RUNNING)
    return {"services": (service,), "whole_hash": whole_hash, "current": current}


def test_a_host_that_is_offline_gets_it_when_it_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Said once, however often it is asked; a host that has its bundle is not asked again."""
    script = Script(monkeypatch, offline=3)
    states, told = brought()
    one, two = (bundle.digest for bundle in bundles().values())
    assert sorted(told) == sorted(
        [f"drone1: got bundle {one}", "drone2: No route to host", f"drone2: got bundle {two}"]
    )
    assert not any(state.words for state in states.values())
    assert script.calls.count(("drone1", "state")) == 1
    assert {word for _, word in script.calls} == {"state", "install"}, "nothing was started"


@pytest.mark.parametrize(
    ("report", "told"),
    [
        ({"version": "0.1.0"}, f"has swarm-ctl 0.1.0: pip install swarm-ctl=={__version__} there"),
        (running(), f"agent-3: runs with plan {OLD}; --restart lands it first"),
        (
            running(whole_hash(), "0" * 12),
            "agent-3: runs with the same plan in another bundle; --restart lands it first",
        ),
        ({"attention": ("/dev/ttyACM0 is not there",)}, "/dev/ttyACM0 is not there"),
    ],
)
def test_what_keeps_a_host_from_flying_the_plan(
    monkeypatch: pytest.MonkeyPatch, report: dict[str, object], told: str
) -> None:
    script = Script(monkeypatch, **report)
    states, lines = brought()
    assert states["drone2"].words == told
    assert f"drone2: {told}" in lines
    assert ("drone2", "start") not in script.calls


def test_status_compares_with_a_mission_and_the_fleet_that_is_asked_about(tmp_path: Path) -> None:
    """One and the same by the mission and its plan file; another by another fleet."""
    mission, outdoors = tmp_path / "trio.yaml", tmp_path / "outdoors.yaml"
    mission.write_text(TEXT)
    found = []
    for port in (14601, 14701):
        rows = "".join(
            f"  - {{id: {k}, host: drone{k}, endpoint: 'udpout:127.0.0.1:{port + k}',"
            f" mesh: tcp/127.0.0.1:{7440 + k}}}\n"
            for k in (1, 2, 3)
        )
        outdoors.write_text(f"version: 1\nagents:\n{rows}")
        loaded = load(mission, fleet=outdoors)
        file = tmp_path / "plan.json"
        file.write_text(plan_to_json(loaded.plan, loaded.fleet))
        assert _whole_hash(mission, outdoors) == _whole_hash(file, outdoors)
        found.append(_whole_hash(file, file))
    assert found[0] != found[1]


def test_what_runs_is_left_or_landed_as_the_operator_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same bundle runs on; another one waits behind it, with --restart."""
    digest = bundles()["drone2"].digest
    script = Script(monkeypatch, next=digest, **running(current=digest))
    assert not brought()[0]["drone2"].words
    assert ("drone2", "install") not in script.calls
    Script(monkeypatch, **running())
    assert not brought(restart=True)[0]["drone2"].words


def test_no_agent_starts_below_those_that_fly() -> None:
    """All run, or none does: a router counts for neither."""
    made = bundles()

    def stand(one: ReportedState, two: ReportedState, three: ReportedState) -> str:
        first = HostReport(
            version="",
            manager="",
            services=(
                ServiceReport(name="router", state=ReportedState.RUNNING),
                ServiceReport(name="agent-1", state=one),
                ServiceReport(name="agent-2", state=two),
            ),
        )
        second = first.model_copy(
            update={"services": (ServiceReport(name="agent-3", state=three),)}
        )
        states = {
            "drone1": HostState("drone1", Reach.ANSWERED, report=first),
            "drone2": HostState("drone2", Reach.ANSWERED, report=second),
        }
        return parted(states, made)

    assert stand(ReportedState.RUNNING, ReportedState.RUNNING, ReportedState.RUNNING) == ""
    assert stand(ReportedState.ENDED, ReportedState.STOPPED, ReportedState.FAILED) == ""
    told = stand(ReportedState.RUNNING, ReportedState.ENDED, ReportedState.FAILED)
    assert told.startswith("drone1: agent-2, drone2: agent-3 would start while others may fly (dr")


def test_ssh_asks_no_questions_and_takes_no_host_for_an_option() -> None:
    """The remote side is one word for the login shell, whichever it is."""
    line = Ssh(Path("my config")).line("drone3.local", ["start", "--bundle", "a b; reboot"])
    assert line[:3] == ["ssh", "-F", "my config"]
    assert "BatchMode=yes" in line
    assert line[-3:-1] == ["--", "drone3.local"]
    words = shlex.split(line[-1])
    assert words[:2] == ["sh", "-c"]
    assert words[3:] == ["swarm-ctl", "on-host", "start", "--bundle", "a b; reboot"]
    with pytest.raises(StartError):
        Ssh().line("-oProxyCommand=reboot", ["state"])


@pytest.mark.parametrize(
    ("code", "said", "reach"),
    [
        (0, "", Reach.ANSWERED),
        (1, "error: no", Reach.FAILED),
        (127, "", Reach.MISSING),
        (255, "ssh: connect to host drone3 port 22: No route to host", Reach.OFFLINE),
        (255, "pi@drone3: Permission denied (publickey).", Reach.REFUSED),
        (255, "Host key verification failed.", Reach.REFUSED),
    ],
)
def test_how_far_a_call_came(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, said: str, reach: Reach
) -> None:
    ssh_is(tmp_path, monkeypatch, f"echo '{said}' >&2; exit {code}")
    answer = Ssh().ask("drone3", ["state"], 60.0)
    assert (answer.reach, answer.words) == (reach, said)


def ssh_is(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Let a script be ssh."""
    (folder / "ssh").write_text(f"#!/bin/sh\n{script}\n")
    (folder / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)


def test_what_travels_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bundle to the host, and its logs to a file here: longer than a pipe holds."""
    ssh_is(tmp_path, monkeypatch, "cat")
    data = bytes(range(256)) * 4000
    with (tmp_path / "out").open("w+b") as out:
        answer = Ssh().ask("drone3", ["install", "-"], 60.0, data, out, len(data))
        out.seek(0)
        assert (answer.reach, out.read()) == (Reach.ANSWERED, data)
    assert Ssh().ask("drone3", ["state"], 60.0, b"here").out == b"here"


@pytest.mark.parametrize("script", ["yes", "yes >&2 & exec yes", "(sleep 60 & yes)"])
def test_a_host_that_answers_without_end_is_not_read_to_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str
) -> None:
    """One that was taken over: a megabyte of a report is read, and ssh is ended."""
    ssh_is(tmp_path, monkeypatch, script)
    tracemalloc.start()
    answer = Ssh().ask("drone3", ["state"], 60.0)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert answer.reach is Reach.FAILED
    assert answer.words == "answers more than 1.04858 MB; allowed: less"
    assert most < 8e6


def test_a_host_that_does_not_answer_is_waited_for_so_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ssh_is(tmp_path, monkeypatch, "exec sleep 60")
    answer = Ssh().ask("drone3", ["state"], 0.3)
    assert (answer.reach, answer.words) == (Reach.OFFLINE, "no answer for 0.3 s")


def report(name: str, state: ReportedState, said: str = "", whole_hash: str = OLD) -> HostState:
    service = ServiceReport(name=name, state=state, said=said)
    found = HostReport(
        version="0.2.0", manager="systemd", whole_hash=whole_hash, services=(service,)
    )
    return HostState("", Reach.ANSWERED, report=found)


def test_six_hosts_in_eighty_columns(capsys: pytest.CaptureFixture[str]) -> None:
    """Another plan, a failed agent and a host that is not reached stand out, and in the exit
    code."""
    states = {
        "drone1.local": report("agent-1", ReportedState.RUNNING),
        "drone2.local": report("agent-2", ReportedState.ENDED, "agent: completed"),
        "drone3.local": report("agent-3", ReportedState.RUNNING, whole_hash="f" * 16),
    }
    wanted = common_plan(states)
    assert exit_code({"drone1.local": states["drone1.local"]}, wanted) == 0
    assert exit_code(states, wanted) == 1
    states["drone4.local"] = HostState("drone4.local", Reach.OFFLINE, "No route to host")
    assert exit_code(states, wanted) == 3
    show_hosts(PlainConsole(width=80), states, wanted)
    shown = capsys.readouterr().out
    assert max(map(len, shown.partition("drone2.local: ")[0].split("\n"))) <= 80
    assert f"drone1.local  0.2.0      {OLD}" in shown
    assert f"drone3.local: has plan {'f' * 16}, not {OLD}" in shown
    assert "offline: No route to host" in shown
    assert "drone2.local: agent-2: agent: completed" in shown
