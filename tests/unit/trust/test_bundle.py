"""A bundle may come from anyone."""

from __future__ import annotations

import io
import tarfile
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarm_ctl.errors import TrustError
from swarm_ctl.trust.bundle import install, unpacked
from swarm_ctl.trust.identity import load_identity
from swarm_ctl.trust.names import KeyHolder, Role
from swarm_ctl.trust.provision import Terms, add, new, rotate
from tests.unit.test_archives import sparse
from tests.unit.trust.conftest import NOW

KINDS = (tarfile.REGTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.FIFOTYPE)
NAMES = (
    "../../evil",
    "/evil",
    "agent-3/../../evil",
    "agent-3/mesh.key",
    "agent-3//mesh.key",
    "../agent-3/mesh.key",
    "agent-3/sub/mesh.key",
    "agent-9/mesh.key",
    "evil",
)


def entries(bundle: Path) -> list[tuple[tarfile.TarInfo, bytes]]:
    """What a bundle holds."""
    with tarfile.open(bundle) as archive:
        found = []
        for each in archive:
            content = archive.extractfile(each)
            found.append((each, content.read() if content else b""))
        return found


def packed(path: Path, members: list[tuple[tarfile.TarInfo, bytes]], mode: str = "w:") -> Path:
    """A tar of these members."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode=mode) as archive:  # type: ignore[call-overload]  # a literal
        for info, data in members:
            archive.addfile(info, io.BytesIO(data))
    path.write_bytes(out.getvalue())
    return path


def test_a_host_has_what_it_needs(made: Path, tmp_path: Path) -> None:
    """One file; the folder is as private as the one it came from, whatever the bundle says."""
    members = entries(made / "agent-3.bundle")
    for info, _ in members:
        info.mode, info.uid = 0o4777, 12345
    bundle = packed(tmp_path / "agent-3.bundle", members)
    agent = install(bundle, tmp_path / "host")
    assert agent == load_identity(tmp_path / "host/agent-3")
    assert agent.mavlink_key == (made / "agent-3/mavlink.key").read_bytes()
    assert {path.stat().st_mode & 0o7777 for path in agent.folder.iterdir()} == {0o600}
    assert agent.folder.stat().st_mode & 0o7777 == 0o700


@settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    name=st.one_of(st.sampled_from(NAMES), st.text(min_size=1, max_size=30)),
    kind=st.sampled_from(KINDS),
    link=st.sampled_from(["", "/etc/passwd", "../../evil"]),
    at=st.integers(0, 6),
)
def test_hostile_members_write_nothing(
    made: Path, tmp_path_factory: pytest.TempPathFactory, name: str, kind: bytes, link: str, at: int
) -> None:
    """Whatever stands among the true files: the bundle is refused, and nothing is written."""
    place = tmp_path_factory.mktemp("host")
    info = tarfile.TarInfo(name)
    info.type, info.linkname, info.size = kind, link, 4 if kind == tarfile.REGTYPE else 0
    members = entries(made / "agent-3.bundle")
    members.insert(at, (info, b"evil"[: info.size]))
    bundle = packed(place / "agent-3.bundle", members)
    with pytest.raises(TrustError, match=r"agent-3\.bundle"):
        install(bundle, place / "a" / "b")
    assert list(place.rglob("*")) == [bundle]


@pytest.mark.parametrize("data", [b"", b"no tar", b"\0" * 10240, bytes(range(256)) * 8])
def test_other_files_are_no_bundles(tmp_path: Path, data: bytes) -> None:
    """Refused by name."""
    (tmp_path / "x.bundle").write_bytes(data)
    with pytest.raises(TrustError, match=r"x\.bundle"):
        unpacked(tmp_path / "x.bundle")


def test_a_compressed_or_large_bundle_is_refused(made: Path, tmp_path: Path) -> None:
    """So nothing small becomes large in memory."""
    small = packed(tmp_path / "x.bundle", entries(made / "agent-3.bundle"), "w:gz")
    with pytest.raises(TrustError, match="is no bundle"):
        unpacked(small)
    small.write_bytes(bytes(2 << 20))
    with pytest.raises(TrustError, match="at most"):
        unpacked(small)


def test_a_newer_bundle_keeps_the_stamp(trust: Path, tmp_path: Path) -> None:
    """And an older one is refused: it would name who was revoked."""
    old = (trust / "agent-3.bundle").read_bytes()
    host = tmp_path / "host"
    install(trust / "agent-3.bundle", host)
    (host / "agent-3/stamp").write_bytes(b"37561348440580020")
    rotate(trust, Terms(NOW))
    assert install(trust / "agent-3.bundle", host).epoch == 2
    assert (host / "agent-3/stamp").read_bytes() == b"37561348440580020"
    (tmp_path / "old.bundle").write_bytes(old)
    with pytest.raises(TrustError, match=r"epoch 2.*epoch 1"):
        install(tmp_path / "old.bundle", host)
    assert load_identity(host / "agent-3").epoch == 2


def test_a_bundle_of_another_ca_does_not_replace(trust: Path, tmp_path: Path) -> None:
    """Of a swarm of the same name; the host's files stay."""
    new(tmp_path / "other", "outdoors", {3: "127.0.0.1"}, [], [], Terms(NOW))
    host = tmp_path / "host"
    before = install(trust / "agent-3.bundle", host)
    with pytest.raises(TrustError, match="is of another CA"):
        install(tmp_path / "other/agent-3.bundle", host)
    assert load_identity(host / "agent-3") == before


def test_parts_of_two_bundles_do_not_fit(trust: Path, tmp_path: Path) -> None:
    """Agent 1's key in agent 3's bundle: nothing is written."""
    other = {info.name.split("/")[1]: data for info, data in entries(trust / "agent-1.bundle")}
    mixed = []
    for info, data in entries(trust / "agent-3.bundle"):
        put = other["mesh.key"] if info.name.endswith("mesh.key") else data
        info.size = len(put)
        mixed.append((info, put))
    bundle = packed(tmp_path / "agent-3.bundle", mixed)
    with pytest.raises(TrustError, match=r"host/agent-3/mesh\.key: is not the key of"):
        install(bundle, tmp_path / "host")
    assert list((tmp_path / "host").iterdir()) == []


def test_a_bundle_without_a_key_needs_the_hosts(trust: Path, tmp_path: Path) -> None:
    """The text says which command makes it."""
    (trust / "agent-3/mesh.key").unlink()
    add(trust, KeyHolder(Role.VIEWER, "desk"), "", Terms(NOW))
    with pytest.raises(TrustError, match="swarm-ctl trust request agent 3"):
        install(trust / "agent-3.bundle", tmp_path / "host")


def test_a_file_with_holes_takes_no_memory(tmp_path: Path) -> None:
    """A header of 512 bytes says 4 GB."""
    bundle = tmp_path / "agent-3.bundle"
    bundle.write_bytes(sparse("agent-3/mesh.key"))
    tracemalloc.start()
    with pytest.raises(TrustError, match="no plain file"):
        unpacked(bundle)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 8_000_000
