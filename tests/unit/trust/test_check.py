"""Each thing that keeps a swarm from flying with its keys is found on the ground."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest

from swarm_ctl.errors import TrustError
from swarm_ctl.trust.check import FleetNames, TrustReport, check
from swarm_ctl.trust.explain import Answer
from swarm_ctl.trust.provision import Terms, new, rotate
from tests.unit.trust.conftest import NOW

FLEET = FleetNames({1: None, 2: "tcp/127.0.0.1:7447", 3: "tcp/192.168.1.13:7447"})


def texts(report: TrustReport) -> str:
    """All that needs attention."""
    own = [f"{each.member}: {text}" for each in report.members for text in each.attention]
    return "\n".join((*report.attention, *own))


@pytest.fixture(autouse=True)
def nothing_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test of this module talks to the network."""
    monkeypatch.setattr("swarm_ctl.trust.check.ask", lambda *_: Answer(reached=False))


def test_a_new_folder_is_fine(made: Path) -> None:
    """The ground's folder, with its fleet."""
    report = check(made, NOW, FLEET)
    assert texts(report) == ""
    assert not report.needs_attention
    assert [each.member for each in report.members] == [
        "agent 1",
        "agent 2",
        "agent 3",
        "operator anna",
        "viewer tv",
    ]
    assert "agent 3 does not listen at tcp/192.168.1.13:7447" in report.notes[-1]


def test_a_key_that_stays_on_its_host_is_no_fault(trust: Path) -> None:
    """It is said. Away from the ground, where the folder `ca` is, it is one."""
    (trust / "agent-3/mesh.key").unlink()
    report = check(trust, NOW)
    assert not report.needs_attention
    assert report.members[2].notes == ("its private key is on its own host",)
    shutil.rmtree(trust / "ca")
    assert "mesh.key: can't be read" in texts(check(trust, NOW))


def chmod(name: str) -> Callable[[Path], None]:
    return lambda trust: (trust / name).chmod(0o644 if (trust / name).is_file() else 0o755)


def copy(source: str, to: str) -> Callable[[Path], None]:
    return lambda trust: (trust / to).write_bytes((trust / source).read_bytes())


def write(name: str, data: bytes) -> Callable[[Path], None]:
    def put(trust: Path) -> None:
        (trust / name).write_bytes(data)
        (trust / name).chmod(0o600)

    return put


def remove(name: str) -> Callable[[Path], None]:
    return lambda trust: (trust / name).unlink()


def rewrite(name: str) -> Callable[[Path], None]:
    def change(trust: Path) -> None:
        text = (trust / name).read_text()
        (trust / name).write_text(text.replace('"epoch": 1', '"epoch": 9', 1))

    return change


STAMP_2050 = str(35 * 365 * 86400 * 100_000).encode()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (chmod("agent-3/mesh.key"), "agent 3: .*mesh.key.*0644.*allowed: 0600"),
        (chmod("agent-3/mavlink.key"), "agent 3: .*mavlink.key.*0644.*allowed: 0600"),
        (chmod("agent-3/roster.pem"), "agent 3: .*roster.pem.*0644.*allowed: 0600"),
        (chmod("operator-anna"), "operator anna: .*0755.*allowed: 0700"),
        (chmod("ca/ca.key"), "ca.key.*0644.*allowed: 0600"),
        (chmod("agent-1.bundle"), "agent-1.bundle.*0644.*allowed: 0600"),
        (copy("agent-1/mesh.key", "agent-3/mesh.key"), "agent 3: .*is not the key of"),
        (copy("agent-1/mesh.key", "ca/ca.key"), "ca.key: is not the key of"),
        (copy("agent-1/mavlink.key", "agent-3/mavlink.key"), "agent 1 and agent 3 have the same"),
        (remove("agent-3/mavlink.key"), "agent 3: .*mavlink.key: is missing"),
        (write("agent-3/mavlink.key", b"short"), "agent 3: .*has 5 bytes; allowed: 32"),
        (rewrite("agent-3/roster.json"), "agent 3: .*the roster was changed"),
        (rewrite("roster.json"), "roster.json: .*the roster was changed"),
        (remove("agent-3/roster.pem"), "agent 3: .*roster.pem"),
        (
            write("agent-3/stamp", STAMP_2050),
            "agent 3: this machine.* before the last flight's stamp",
        ),
        (write("agent-3/stamp", b"soon"), "agent 3: .*has no stamp"),
        (lambda trust: shutil.rmtree(trust / "agent-3"), "agent-3: is missing; the roster names"),
    ],
)
def test_damage_is_found(trust: Path, damage: Callable[[Path], None], words: str) -> None:
    """Each with what is allowed, and the member that it is about."""
    damage(trust)
    report = check(trust, NOW)
    assert report.needs_attention
    (found,) = texts(report).splitlines()
    assert re.search(words, found)


@pytest.mark.parametrize(
    ("passed", "words"),
    [
        (timedelta(days=-1), "is not valid before"),
        (timedelta(days=29, hours=1), "ends in under 24 h"),
        (timedelta(days=30, hours=1), "expired on"),
    ],
)
def test_dates(made: Path, passed: timedelta, words: str) -> None:
    """Of each member; under 24 h no agent arms."""
    report = check(made, NOW + passed)
    assert all(words in each.attention[0] for each in report.members)


def test_a_fleet_with_another_address_or_another_agent(made: Path) -> None:
    """Both are named, with the command that helps."""
    found = texts(check(made, NOW, FleetNames({1: "tcp/10.0.0.1:7447", 9: None})))
    assert "agent 1: its certificate is for another address: agent-1.outdoors.e1, 127" in found
    assert "the fleet has agent 9, the roster of epoch 1 has not" in found


def test_an_old_bundle_beside_new_ones(trust: Path) -> None:
    """A member that was not given the new roster."""
    old = shutil.copytree(trust / "agent-3", trust.parent / "agent-3")
    rotate(trust, Terms(NOW))
    shutil.rmtree(trust / "agent-3")
    shutil.move(old, trust / "agent-3")
    assert "its roster is of epoch 1, the newest here is of epoch 2" in texts(check(trust, NOW))


def test_identities_of_two_cas(trust: Path, tmp_path: Path) -> None:
    """Bundles of two `trust new` in one folder."""
    new(tmp_path / "other", "outdoors", {7: "127.0.0.1"}, [], [], Terms(NOW))
    shutil.copytree(tmp_path / "other/agent-7", trust / "agent-7")
    assert "identities of several CAs" in texts(check(trust, NOW))


def test_a_refused_handshake(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With each agent that listens; another agent at its endpoint is a refusal, too."""
    answers = {
        "tcp/127.0.0.1:7447": Answer(True, peer="agent-3.outdoors.e1"),
        "tcp/192.168.1.13:7447": Answer(True, "it has expired"),
    }
    monkeypatch.setattr("swarm_ctl.trust.check.ask", lambda _, endpoint: answers[endpoint])
    found = texts(check(made, NOW, FLEET))
    assert "agent 2: at tcp/127.0.0.1:7447 answers agent-3.outdoors.e1; allowed: agent-2" in found
    assert "agent 3: it has expired" in found


def test_a_folder_that_is_none(tmp_path: Path) -> None:
    """Bad input."""
    with pytest.raises(TrustError, match="can't be read"):
        check(tmp_path / "nothing", NOW)
    with pytest.raises(TrustError, match="has no identity"):
        check(tmp_path, NOW)
