"""A large swarm with keys behind its router: the router judges each client by its certificate, the
clients the router by its own. With real zenoh sessions."""

from __future__ import annotations

import contextlib
import itertools
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import pytest
import zenoh

from swarm_ctl.engine.launch.forked import HostRouter
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.protection import router_identity, router_identity_folder
from swarm_ctl.errors import TrustError
from swarm_ctl.mesh.access import access_settings, as_tls
from swarm_ctl.mesh.keys import CHANNELS, COMMAND, SIGHTING, STATE, alive_key
from swarm_ctl.mesh.zenoh_config import MeshPart, configuration
from swarm_ctl.mesh.zenoh_transport import Router, ZenohTransport
from swarm_ctl.trust import provision
from swarm_ctl.trust.identity import load_identity
from tests.security.test_impostors import SWARM, VICTIM, until
from tests.unit.report.run_folders import write_routed

pytestmark = pytest.mark.realtime
ROUTERS: Final = ["127.0.0.1", "10.0.0.2", "127.0.0.1"]
WORDS: Final = 30
"""Honest words that arrive while an impostor says each of its own as often."""


@pytest.fixture(scope="module")
def trust(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trust")
    hosts = dict.fromkeys((1, 2, 3, 7), "127.0.0.1")
    terms = provision.Terms(datetime.now(UTC))
    for name in ("field", "other"):
        people = ["anna", "bob"], ["tv"]
        provision.new(folder / name, "field", hosts, *people, terms, ROUTERS)
    return folder


def settings(folder: Path, *, careless: bool = False) -> dict[str, Any]:
    """What a member tells zenoh; one who is `careless` lets everything through."""
    found = access_settings(load_identity(folder), SWARM)
    if careless:
        del found["access_control"]
    return found


@pytest.fixture
def at() -> str:
    return f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def client(opened: ExitStack, at: str, access: Any) -> ZenohTransport:
    one = ZenohTransport([], [at], time.monotonic, access=access, part=MeshPart.CLIENT)
    return opened.enter_context(closing(one))


@pytest.mark.parametrize(
    ("impostor", "said"),
    [
        ("field/viewer-tv", set()),
        ("field/agent-7", {("agent", "7")}),
        ("field/operator-bob", {("station", "bob.1-a")}),
        ("other/agent-3", None),
        ("no keys", None),
    ],
)
def test_a_client_says_its_own_alone(
    trust: Path, at: str, opened: ExitStack, impostor: str, said: set[tuple[str, str]] | None
) -> None:
    """On every channel, as agent 3, as a station of anna's and as itself: a client that lets
    everything through is heard through the router under its own keys alone; a stranger (None) has
    no link. Honest members are heard meanwhile."""
    field = trust / "field"
    opened.enter_context(closing(Router([at], [], access=settings(field / "router-1"))))
    hearing = client(opened, at, settings(field / "agent-1"))
    honest = client(opened, at, settings(field / "agent-2"))
    anna = client(opened, at, settings(field / "operator-anna"))
    keys = None if impostor == "no keys" else settings(trust / impostor, careless=True)
    spy = client(opened, at, keys)
    inlets = [hearing.subscribe(channel.key_expression(SWARM)) for channel in CHANNELS]
    overheard = spy.subscribe(STATE.key_expression(SWARM))
    owners = itertools.cycle((*VICTIM.items(), ("agent", "7"), ("station", "bob.1-a")))
    found, heard, spied = set[tuple[str, str]](), {b"state": 0, b"command": 0, b"sighting": 0}, 0

    def spoken() -> bool:
        nonlocal spied
        honest.publish(STATE.key(SWARM, 2), b"state", STATE.qos)
        anna.publish(COMMAND.key(SWARM, "anna.1-a"), b"command", COMMAND.qos)
        anna.publish(SIGHTING.key(SWARM, "anna.1-a"), b"sighting", SIGHTING.qos)
        kind, name = next(owners)  # one at a time: a router takes a bounded rate of each link
        for channel in CHANNELS:
            if channel.publisher == kind:
                spy.publish(channel.key(SWARM, name), b"spy", channel.qos)
        for inlet in inlets:
            for _, key, data in inlet.drain():
                if bytes(data) == b"spy":
                    found.add((key.split("/")[2], key.split("/")[3]))
                else:
                    heard[bytes(data)] += 1
        spied += len(overheard.drain())
        return (
            min(heard.values()) > WORDS
            and (said is None or spied > WORDS)
            and found == (said or set())
        )

    until(spoken)
    assert found == (said or set())
    assert bool(spied) is (said is not None)


def test_an_agent_that_plays_the_router(trust: Path, at: str, opened: ExitStack) -> None:
    """It takes the router's port, passes on all, and its clients believe of it what an agent may
    say: nothing of the others."""
    field = trust / "field"
    opened.enter_context(
        closing(Router([at], [], access=settings(field / "agent-7", careless=True)))
    )
    hearing = client(opened, at, settings(field / "agent-1"))
    honest = client(opened, at, settings(field / "agent-2", careless=True))
    careless = client(opened, at, settings(field / "agent-3", careless=True))
    refused, passed = (each.subscribe(STATE.key_expression(SWARM)) for each in (hearing, careless))
    count, owners, names = 0, set(), itertools.cycle((2, 7))

    def passed_on() -> bool:
        nonlocal count
        honest.publish(STATE.key(SWARM, next(names)), b"state", STATE.qos)
        count += len(passed.drain())
        owners.update(key.split("/")[3] for _, key, _ in refused.drain())
        return count > WORDS and "7" in owners

    until(passed_on)
    assert owners == {"7"}


def test_routers_hear_each_other(trust: Path, at: str, opened: ExitStack) -> None:
    """Agents of two hosts, with keys: a state goes by both routers."""
    field = trust / "field"
    other = f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM, [int(at.rpartition(':')[2])])[0]}"
    opened.enter_context(closing(Router([at], [], access=settings(field / "router-1"))))
    opened.enter_context(closing(Router([other], [at], access=settings(field / "router-3"))))
    here = client(opened, at, settings(field / "agent-1"))
    inlet = here.subscribe(STATE.key_expression(SWARM))
    there = client(opened, other, settings(field / "agent-2"))

    def heard() -> bool:
        there.publish(STATE.key(SWARM, 2), b"state", STATE.qos)
        return bool(inlet.drain())

    until(heard)


def test_whose_keys_a_router_takes(trust: Path) -> None:
    """Those of the router for the address where it listens, and no agent's."""
    field = str(trust / "field")
    assert router_identity_folder(None, "tcp/10.0.0.2:7447") is None
    assert router_identity_folder(field, "tls/10.0.0.2:7447") == trust / "field/router-2"
    with pytest.raises(TrustError, match=r"has no router for 10\.0\.0\.9"):
        router_identity_folder(field, "tls/10.0.0.9:7447")
    with pytest.raises(TrustError, match="is agent 1; allowed: the identity of a router"):
        router_identity(trust / "field/agent-1")


def test_a_router_says_whose_link_it_refused(trust: Path, at: str, tmp_path: Path) -> None:
    """A stranger without TLS: once, however often it tries."""
    said: list[str] = []
    write_routed(tmp_path, as_tls(at), swarm=SWARM, trust=str(trust / "field"))
    host = HostRouter(tmp_path, said.append, 10.0)
    try:
        until(host.child.poll_ready)

        def told() -> bool:
            with contextlib.suppress(OSError), socket.create_connection(_address(at), 1.0) as one:
                one.sendall(b"hello, I am no member of this swarm\n" * 4)
            host.look()
            return bool(said)

        until(told)
        for _ in range(10):
            assert told()
            time.sleep(0.05)
        why = "the other end speaks no TLS: it flies without trust, or is no agent"
        assert said == [f"the router: refused on the mesh: a link: {why}"]
    finally:
        host.child.kill()


def _address(at: str) -> tuple[str, int]:
    host, _, port = at.rpartition("/")[2].rpartition(":")
    return host, int(port)


@pytest.mark.parametrize("routed", [True, False])
def test_a_token_is_its_owners(trust: Path, at: str, opened: ExitStack, *, routed: bool) -> None:
    """A member says that it is there itself alone: agent 7's token under agent 3's key reaches no
    member, whichever way the swarm is linked. A viewer sees the others'."""
    field, listen = trust / "field", [] if routed else [at]
    seven, part = settings(field / "agent-7", careless=True), MeshPart.CLIENT
    if routed:
        keys = settings(field / "router-1")
        key = alive_key(SWARM, "router", "1")
        opened.enter_context(closing(Router([at], [], access=keys, alive=key)))
    for owner, claimed, access in (("1", "1", settings(field / "agent-1")), ("7", "3", seven)):
        connect = [] if listen and owner == "1" else [at]
        ways = (listen if owner == "1" else [], connect, time.monotonic)
        here = MeshPart.CLIENT if routed else MeshPart.PEER
        alive = alive_key(SWARM, "agent", claimed)
        one = ZenohTransport(*ways, access=access, part=here, alive=alive)
        opened.enter_context(closing(one))
    viewer = settings(field / "viewer-tv", careless=True)
    config = configuration([], [at], 1.0, patient=False, access=viewer, part=part)
    with closing(zenoh.open(config)) as session:
        heard: list[str] = []
        everything = session.liveliness().declare_subscriber(
            f"swarm/{SWARM}/**", lambda told: heard.append(str(told.key_expr)), history=True
        )
        expected = [alive_key(SWARM, "agent", 1)]
        expected += [alive_key(SWARM, "router", 1)] if routed else []
        until(lambda: len(heard) >= len(expected))
        time.sleep(0.5)  # for what must not come
        everything.undeclare()
        assert sorted(heard) == expected
