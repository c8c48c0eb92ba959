"""Making and changing a trust folder."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from swarm_ctl.errors import TrustError
from swarm_ctl.trust import files
from swarm_ctl.trust.bundle import install
from swarm_ctl.trust.identity import identity_folder, load_identity
from swarm_ctl.trust.names import KeyHolder, Role
from swarm_ctl.trust.provision import Terms, add, new, request, request_of, revoke, rotate
from swarm_ctl.trust.roster import Roster, read_roster
from tests.unit.trust.conftest import NOW

TERMS = Terms(NOW)
AGENT_3 = KeyHolder(Role.AGENT, "3")


def roster_of(trust: Path) -> Roster:
    """The signed roster of a trust folder."""
    return read_roster(trust, trust / "ca/ca.crt")


def everything(folder: Path) -> dict[str, bytes]:
    """The files of a folder."""
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def no_umask() -> Iterator[None]:
    """A process that gives others everything, where a file's own mode does not forbid it."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("no_umask")
def test_nothing_is_for_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders 0700, files 0600, and so is each file at the moment it gets its content."""
    seen: list[int] = []
    fdopen = os.fdopen

    def look(descriptor: int, mode: str) -> object:
        seen.append(stat.S_IMODE(os.fstat(descriptor).st_mode))
        return fdopen(descriptor, mode)

    monkeypatch.setattr(os, "fdopen", look)
    new(tmp_path / "outdoors", "outdoors", {1: "127.0.0.1"}, ["anna"], ["tv"], TERMS)
    add(tmp_path / "outdoors", KeyHolder(Role.OPERATOR, "bob"), "", TERMS)
    assert set(seen) == {0o600}
    for path in (tmp_path / "outdoors", *(tmp_path / "outdoors").rglob("*")):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path


def test_no_repository_takes_the_keys(trust: Path) -> None:
    """git ignores the folder, after a change too."""
    rotate(trust, TERMS)
    assert (trust / ".gitignore").read_text() == "*\n"


def test_a_second_new_is_refused(trust: Path) -> None:
    """Nothing is changed, and nothing is left beside it."""
    before, beside = everything(trust), list(trust.parent.iterdir())
    with pytest.raises(TrustError, match="is there already"):
        new(trust, "outdoors", {1: "127.0.0.1"}, [], [], TERMS)
    assert (everything(trust), list(trust.parent.iterdir())) == (before, beside)


def test_a_change_that_fails_changes_nothing(trust: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk is full while the bundles are written."""
    before, beside = everything(trust), list(trust.parent.iterdir())

    def full(_: Path) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("swarm_ctl.trust.provision.pack", full)
    with pytest.raises(OSError, match="No space"):
        rotate(trust, TERMS)
    assert (everything(trust), list(trust.parent.iterdir())) == (before, beside)


def test_a_change_that_can_not_take_its_place_changes_nothing(
    trust: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The old folder is put back, and not removed with what was made."""
    before, beside = everything(trust), list(trust.parent.iterdir())
    rename, moved = Path.rename, list[Path]()

    def fails_once(self: Path, target: Path) -> Path:
        moved.append(self)
        if len(moved) == 2:
            raise OSError(5, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fails_once)
    with pytest.raises(OSError, match="Input/output"):
        rotate(trust, TERMS)
    assert (everything(trust), list(trust.parent.iterdir())) == (before, beside)


def test_two_changes_at_once_are_refused(trust: Path) -> None:
    """The second would lose what the first adds."""
    with files.changed_folder(trust), pytest.raises(TrustError, match="another process"):
        rotate(trust, TERMS)


def test_an_operator_more(trust: Path) -> None:
    """In the same epoch; each member's roster names all."""
    add(trust, KeyHolder(Role.OPERATOR, "bob"), "", TERMS)
    bob = load_identity(identity_folder(trust, Role.OPERATOR, "bob"))
    assert bob.common_name == "operator-bob.outdoors.e1"
    known = load_identity(trust / "agent-1").roster.of(KeyHolder(Role.OPERATOR, "bob"))
    assert known is not None
    assert known.common_name == bob.common_name
    with pytest.raises(TrustError, match="has operator bob already"):
        add(trust, KeyHolder(Role.OPERATOR, "bob"), "", TERMS)


def test_a_revoked_agent_is_named_no_more(trust: Path) -> None:
    """A new epoch, new common names and serials for all others, and no old one is named."""
    before = roster_of(trust)
    revoke(trust, AGENT_3, TERMS)
    after = roster_of(trust)
    assert (before.epoch, after.epoch) == (1, 2)
    agents = [each.common_name for each in after.current if each.role is Role.AGENT]
    assert agents == ["agent-1.outdoors.e2", "agent-2.outdoors.e2"]
    assert not {each.serial for each in before.entries} & {each.serial for each in after.current}
    gone = after.entry("agent-3.outdoors.e1")
    assert gone is not None
    assert gone.revoked
    assert not (trust / "agent-3").exists()
    assert not (trust / "agent-3.bundle").exists()
    assert load_identity(trust / "agent-1").common_name == "agent-1.outdoors.e2"


def test_a_revoked_agent_may_come_back(trust: Path) -> None:
    """Under another name, with another key for its vehicle."""
    vehicle = (trust / "agent-3/mavlink.key").read_bytes()
    revoke(trust, AGENT_3, TERMS)
    add(trust, AGENT_3, "192.168.1.13", TERMS)
    agent = load_identity(trust / "agent-3")
    assert agent.common_name == "agent-3.outdoors.e2"
    assert agent.mavlink_key != vehicle
    revoke(trust, AGENT_3, TERMS)
    names = {each.common_name for each in roster_of(trust).entries if each.revoked}
    assert names == {"agent-3.outdoors.e1", "agent-3.outdoors.e2"}


def test_rotation(trust: Path) -> None:
    """New keys and certificates, for a new address; the vehicles keep their keys."""
    before = load_identity(trust / "agent-3")
    key = before.key_file.read_bytes()
    rotate(trust, Terms(NOW + timedelta(days=20)), {KeyHolder(Role.AGENT, "3"): "10.0.0.3"})
    after = load_identity(trust / "agent-3")
    assert after.common_name == "agent-3.outdoors.e2"
    assert after.certificate.hosts == ("agent-3.outdoors.e2", "10.0.0.3")
    assert after.certificate.not_after > before.certificate.not_after
    assert after.key_file.read_bytes() != key
    assert after.mavlink_key == before.mavlink_key


def test_a_key_that_never_leaves_its_host(tmp_path: Path, trust: Path) -> None:
    """The host makes key and request, the CA signs, the certificate goes back; a rotation signs the
    same key again."""
    host = tmp_path / "host" / "outdoors"
    csr = tmp_path / "agent-7.csr"
    csr.write_bytes(request(host, KeyHolder(Role.AGENT, "7")))
    key = (host / "agent-7/mesh.key").read_bytes()
    member, public = request_of(csr)
    add(trust, member, "192.168.1.17", Terms(NOW, requests={member: public}))
    assert not (trust / "agent-7/mesh.key").exists()
    assert b"PRIVATE" not in (trust / "agent-7.bundle").read_bytes().replace(
        (trust / "roster.pem").read_bytes(), b""
    )
    assert install(trust / "agent-7.bundle", host).common_name == "agent-7.outdoors.e1"
    rotate(trust, TERMS)
    assert install(trust / "agent-7.bundle", host).common_name == "agent-7.outdoors.e2"
    assert (host / "agent-7/mesh.key").read_bytes() == key


def test_new_with_a_request(tmp_path: Path) -> None:
    """And a request for an agent that the fleet has not is refused."""
    csr = tmp_path / "agent-3.csr"
    csr.write_bytes(request(tmp_path / "host", AGENT_3))
    terms = Terms(NOW, requests=dict([request_of(csr)]))
    with pytest.raises(TrustError, match="a request is for agent 3; allowed: agent 1"):
        new(tmp_path / "outdoors", "outdoors", {1: "127.0.0.1"}, [], [], terms)
    new(tmp_path / "outdoors", "outdoors", {3: "127.0.0.1"}, [], [], terms)
    assert not (tmp_path / "outdoors/agent-3/mesh.key").exists()


def test_a_changed_request_is_refused(tmp_path: Path) -> None:
    """It is signed by its own key."""
    csr = tmp_path / "agent-3.csr"
    text = request(tmp_path / "host", AGENT_3)
    changed = [
        text[:at] + (b"A" if text[at:][:1] != b"A" else b"B") + text[at + 1 :]
        for at in range(40, 240, 7)
    ]
    for data in (*changed, b"no request", text[:100]):
        csr.write_bytes(data)
        with pytest.raises(TrustError, match=r"agent-3\.csr"):
            request_of(csr)


@pytest.mark.parametrize(
    ("swarm", "host", "operator", "words"),
    [
        ("Out_doors", "10.0.0.1", "anna", "no swarm's name"),
        ("a" * 25, "10.0.0.1", "anna", "no swarm's name"),
        ("outdoors", "0.0.0.0", "anna", "no address that a peer connects to"),  # noqa: S104  # refused
        ("outdoors", "::", "anna", "no address that a peer connects to"),
        ("outdoors", "a b", "anna", "is no address"),
        ("outdoors", "10.0.0.1", "../anna", "is no name"),
        ("outdoors", "10.0.0.1", "anna.b", "is no name"),
    ],
)
def test_names_that_no_certificate_holds(
    tmp_path: Path, swarm: str, host: str, operator: str, words: str
) -> None:
    """Refused before anything is made."""
    with pytest.raises(TrustError, match=words):
        new(tmp_path / "trust", swarm, {1: host}, [operator], [], TERMS)
    assert list(tmp_path.iterdir()) == []
