"""What proves an identity, and what is refused."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import pytest

from swarm_ctl.errors import TrustError
from swarm_ctl.trust.identity import certificates_end, identity_folder, load_identity
from swarm_ctl.trust.names import Role
from swarm_ctl.trust.provision import Terms, new
from tests.unit.trust.conftest import NOW


def test_an_identity_says_who_it_is(made: Path) -> None:
    """Folder, common name, role, swarm, id, epoch, the addresses and both keys of agent 3."""
    agent = load_identity(made / "agent-3")
    assert agent.common_name == "agent-3.outdoors.e1"
    assert (agent.role, agent.agent_id, agent.swarm, agent.epoch) == (Role.AGENT, 3, "outdoors", 1)
    assert agent.certificate.hosts == ("agent-3.outdoors.e1", "192.168.1.13")
    assert agent.mavlink_key is not None
    assert len(agent.mavlink_key) == 32
    assert certificates_end(agent) - NOW > timedelta(days=29, hours=23)
    operators = [each for each in agent.roster.current if each.role is Role.OPERATOR]
    assert [each.common_name for each in operators] == ["operator-anna.outdoors.e1"]


def test_its_secret_is_not_shown(made: Path) -> None:
    """The MAVLink key does not reach a log by way of `repr`."""
    agent = load_identity(made / "agent-3")
    assert agent.mavlink_key is not None
    assert repr(agent.mavlink_key) not in repr(agent)


@pytest.mark.parametrize("name", ["mesh.key", "mesh.crt", "ca.crt", "roster.json", "mavlink.key"])
def test_files_that_others_may_read_are_refused(trust: Path, name: str) -> None:
    """The text names the file, its mode and the mode that is allowed."""
    (trust / "agent-3" / name).chmod(0o644)
    with pytest.raises(TrustError, match=rf"{name}.*0644.*allowed: 0600"):
        load_identity(trust / "agent-3")


def test_a_folder_that_others_may_enter_is_refused(trust: Path) -> None:
    """Mode 0755."""
    (trust / "agent-3").chmod(0o755)
    with pytest.raises(TrustError, match=r"0755.*allowed: 0700"):
        load_identity(trust / "agent-3")


def test_a_changed_roster_is_refused(trust: Path) -> None:
    """A viewer can't be made an operator with an editor."""
    path = trust / "agent-3" / "roster.json"
    path.write_text(path.read_text().replace('"viewer"', '"operator"'))
    with pytest.raises(TrustError, match="the roster was changed"):
        load_identity(trust / "agent-3")


def test_a_roster_of_another_ca_is_refused(trust: Path, tmp_path: Path) -> None:
    """A roster that another CA signed, of a swarm of the same name."""
    other = tmp_path / "other"
    new(other, "outdoors", {3: "192.168.1.13"}, ["mallory"], [], Terms(NOW))
    for name in ("roster.json", "roster.pem"):
        (trust / "agent-3" / name).write_bytes((other / name).read_bytes())
    with pytest.raises(TrustError, match="does not vouch for it"):
        load_identity(trust / "agent-3")


def test_a_key_of_another_is_refused(trust: Path) -> None:
    """Certificate and key are no pair."""
    (trust / "agent-3/mesh.key").write_bytes((trust / "agent-1/mesh.key").read_bytes())
    with pytest.raises(TrustError, match="is not the key of"):
        load_identity(trust / "agent-3")


def test_a_certificate_in_the_folder_of_another_is_refused(trust: Path) -> None:
    """Agent 1's certificate and key in agent 3's folder."""
    for name in ("mesh.key", "mesh.crt"):
        (trust / "agent-3" / name).write_bytes((trust / "agent-1" / name).read_bytes())
    with pytest.raises(TrustError, match=r"agent-1\.outdoors\.e1.*allowed: agent-3\.outdoors\.e1"):
        load_identity(trust / "agent-3")


@pytest.mark.parametrize("name", ["mesh.key", "mesh.crt", "ca.crt", "roster.json", "roster.pem"])
def test_a_missing_file_is_named(trust: Path, name: str) -> None:
    """Each file that an identity needs."""
    (trust / "agent-3" / name).unlink()
    with pytest.raises(TrustError, match=name):
        load_identity(trust / "agent-3")


@pytest.mark.parametrize("name", ["mesh.key", "mesh.crt", "ca.crt", "roster.pem", "mavlink.key"])
def test_a_damaged_file_is_named(trust: Path, name: str) -> None:
    """Half of each file."""
    path = trust / "agent-3" / name
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(TrustError, match=name):
        load_identity(trust / "agent-3")


def test_an_expired_certificate_still_loads(tmp_path: Path) -> None:
    """An agent that starts again in flight must not end it; the pre-flight check judges dates."""
    folder = tmp_path / "outdoors"
    new(folder, "outdoors", {1: "127.0.0.1"}, [], [], Terms(NOW - timedelta(days=40)))
    assert certificates_end(load_identity(folder / "agent-1")) < NOW


def test_the_only_operator_needs_no_name(made: Path) -> None:
    """Several agents need one."""
    assert identity_folder(made, Role.OPERATOR) == made / "operator-anna"
    with pytest.raises(TrustError, match="name one of them"):
        identity_folder(made, Role.AGENT)
    with pytest.raises(TrustError, match="has no operator bob"):
        identity_folder(made, Role.OPERATOR, "bob")
