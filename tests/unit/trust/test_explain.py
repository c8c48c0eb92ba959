"""Why a handshake fails, in words, against a real TLS server."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from swarm_ctl.trust import explain
from swarm_ctl.trust.explain import ask, explain_handshake
from swarm_ctl.trust.identity import Identity, load_identity
from swarm_ctl.trust.names import KeyHolder, Role
from swarm_ctl.trust.provision import Terms, new, revoke, rotate
from tests.unit.trust.conftest import NOW

LONG_AGO = Terms(NOW - timedelta(days=40))
Listen = Callable[[Identity | None], str]


@pytest.fixture
def listen(monkeypatch: pytest.MonkeyPatch) -> Iterator[Listen]:
    """Starts a member of the mesh that listens, with mutual TLS or (None) without TLS; returns its
    endpoint."""
    monkeypatch.setattr(explain, "_VERDICT_S", 0.1)
    with contextlib.ExitStack() as stack:

        def start(identity: Identity | None) -> str:
            server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            thread = threading.Thread(target=_serve, args=(server, identity), daemon=True)
            thread.start()
            stack.callback(thread.join, 2.0)
            stack.callback(server.shutdown, socket.SHUT_RDWR)
            return f"tls/127.0.0.1:{server.getsockname()[1]}"

        yield start


def _serve(server: socket.socket, identity: Identity | None) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    if identity is not None:
        context.verify_mode = ssl.CERT_REQUIRED
        context.load_verify_locations(identity.ca_file)
        context.load_cert_chain(identity.certificate_file, identity.key_file)
    while True:
        try:
            link, _ = server.accept()
        except OSError:
            return
        with link, contextlib.suppress(OSError):
            if identity is None:
                link.sendall(b"\x05\x00hello")
            else:
                with context.wrap_socket(link, server_side=True) as secured:
                    secured.recv(1)


def test_a_good_link_needs_no_words(made: Path, listen: Listen) -> None:
    """And tells who answered."""
    endpoint = listen(load_identity(made / "agent-1"))
    assert explain_handshake(load_identity(made / "operator-anna"), endpoint) is None
    assert ask(load_identity(made / "agent-2"), endpoint).peer == "agent-1.outdoors.e1"


def test_the_rosters_signature_opens_no_link(trust: Path, listen: Listen) -> None:
    """Each host has its key. It is no client's, and no address is its own."""
    endpoint = listen(load_identity(trust / "agent-1"))
    for name in ("mesh.crt", "mesh.key"):
        shutil.copyfile(trust / "roster.pem", trust / "agent-2" / name)
    sealed = dataclasses.replace(load_identity(trust / "agent-3"), folder=trust / "agent-2")
    as_client = explain_handshake(sealed, endpoint)
    assert as_client is not None
    assert "unsupported certificate" in as_client
    as_server = explain_handshake(load_identity(trust / "operator-anna"), listen(sealed))
    assert as_server is not None
    assert "is for another address: none" in as_server


def test_where_nothing_listens(made: Path) -> None:
    """That is no refusal."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    agent = load_identity(made / "agent-1")
    assert not ask(agent, f"tls/127.0.0.1:{port}").reached
    assert explain_handshake(agent, f"tls/127.0.0.1:{port}") is None


def test_an_open_mesh(made: Path, listen: Listen) -> None:
    """The other end has no trust."""
    why = explain_handshake(load_identity(made / "agent-1"), listen(None))
    assert why is not None
    assert "its mesh is open" in why


def test_another_swarm(made: Path, tmp_path: Path, listen: Listen) -> None:
    """Its certificates are another CA's, though the names are the same."""
    new(tmp_path / "other", "outdoors", {1: "127.0.0.1"}, [], [], Terms(NOW))
    why = explain_handshake(
        load_identity(made / "agent-2"), listen(load_identity(tmp_path / "other/agent-1"))
    )
    assert why is not None
    assert "another CA issued its certificate: it is of another swarm" in why


def test_a_ca_that_the_other_end_does_not_trust(made: Path, tmp_path: Path, listen: Listen) -> None:
    """We trust it, and it does not trust us."""
    new(tmp_path / "other", "outdoors", {2: "127.0.0.1"}, [], [], Terms(NOW))
    folder = shutil.copytree(tmp_path / "other/agent-2", tmp_path / "agent-2")
    stranger = dataclasses.replace(load_identity(tmp_path / "other/agent-2"), folder=folder)
    shutil.copyfile(made / "agent-2/ca.crt", folder / "ca.crt")
    why = explain_handshake(stranger, listen(load_identity(made / "agent-1")))
    assert why is not None
    assert "refuses agent-2.outdoors.e1: it trusts another CA" in why


def test_an_expired_certificate(trust: Path, listen: Listen) -> None:
    """Theirs and ours, with the day."""
    good = load_identity(trust / "agent-1")
    copy = shutil.copytree(trust, trust.parent / "copy")
    rotate(copy, LONG_AGO)
    expired = load_identity(copy / "agent-2")
    ended = f"{expired.certificate.not_after:%Y-%m-%d}"
    theirs = explain_handshake(good, listen(expired))
    assert theirs is not None
    assert "the certificate of agent-2.outdoors.e2 is out of date" in theirs
    assert f"expired on {ended}" in theirs
    ours = explain_handshake(expired, listen(good))
    assert ours is not None
    assert f"refuses agent-2.outdoors.e2: by its clock it expired on {ended}" in ours


def test_a_certificate_of_tomorrow(trust: Path, listen: Listen) -> None:
    """A clock is wrong."""
    good = load_identity(trust / "agent-1")
    copy = shutil.copytree(trust, trust.parent / "copy")
    rotate(copy, Terms(NOW + timedelta(days=1)))
    why = explain_handshake(good, listen(load_identity(copy / "agent-2")))
    assert why is not None
    assert "not valid before" in why
    assert "a right clock" in why


def test_another_address(tmp_path: Path, listen: Listen) -> None:
    """The certificate is for 10.0.0.1, and it listens here."""
    new(tmp_path / "far", "outdoors", {1: "10.0.0.1", 2: "10.0.0.2"}, [], [], Terms(NOW))
    endpoint = listen(load_identity(tmp_path / "far/agent-1"))
    why = explain_handshake(load_identity(tmp_path / "far/agent-2"), endpoint)
    assert why is not None
    assert "agent-1.outdoors.e1 is for another address: 10.0.0.1; allowed: one for 127.0.0.1" in why


def test_an_old_epoch_is_refused_by_permissions(trust: Path, listen: Listen) -> None:
    """TLS accepts its certificate, the access rules do not name it."""
    old = shutil.copytree(trust, trust.parent / "old")
    revoke(trust, KeyHolder(Role.AGENT, "2"), Terms(NOW))
    operator = load_identity(trust / "operator-anna")
    for folder, words in (
        (old / "agent-1", "roster of epoch 2 does not name agent-1.outdoors.e1"),
        (old / "agent-2", "agent-2.outdoors.e1 was revoked"),
    ):
        why = explain_handshake(operator, listen(load_identity(folder)))
        assert why is not None
        assert "refused by permissions: " in why
        assert words in why


def test_an_end_that_says_nothing(made: Path) -> None:
    """An open mesh waits for us to speak; so may a slow link."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        endpoint = f"tls/127.0.0.1:{silent.getsockname()[1]}"
        why = explain_handshake(load_identity(made / "agent-1"), endpoint, 0.1)
    assert why is not None
    assert "answers no TLS within 0.1 s: its mesh is open, or the way there is slow" in why
