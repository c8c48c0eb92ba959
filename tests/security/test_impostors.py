"""Impostors on the mesh, with real zenoh sessions. On an open mesh each of them is heard on every
channel, and hears; on a mesh with keys none is, whichever end opens the link."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import pytest
import zenoh

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh.access import access_settings
from swarm_ctl.mesh.keys import CHANNELS, COMMAND, STATE
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.payloads import encode
from swarm_ctl.mesh.zenoh_config import configuration
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.trust.identity import load_identity
from tests.unit.core.builders import state

pytestmark = pytest.mark.realtime
SWARM: Final = "hexagon"
VICTIM: Final = {"agent": "3", "station": "anna.77-a1b2c3"}
"""Whom the impostors pretend to be."""
PATIENCE_S: Final = 20.0
REFUSED_S: Final = 1.5
"""After all honest links are up: three more attempts of each impostor to open one, at least."""
WORD: Final = tuple(channel.name for channel in CHANNELS)
IMPOSTORS: Final = (
    "plain TCP",
    "no certificate",
    "other CA",
    "expired",
    "old epoch",
    "viewer",
    "agent 7 on key 3",
    "operator bob as anna",
)


MEMBERS: Final = ("viewer", "agent 7 on key 3", "operator bob as anna")
"""Of the swarm, in its present epoch: they may hear all."""


@dataclass
class Deeds:
    """What came of the impostors: the channels on which each was heard, and how much it heard."""

    told: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    heard: dict[str, int] = field(default_factory=lambda: defaultdict(int))

    def complete(self, *, protected: bool) -> bool:
        """All is there that is to come."""
        if protected:
            return bool(self.told["honest"]) and all(self.heard[name] for name in MEMBERS)
        return all(self.heard[name] and len(self.told[name]) == len(WORD) for name in IMPOSTORS)


@pytest.fixture(scope="module")
def trust(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`field`, in its second epoch; `old` of its first; `other` of another CA, with the same
    names."""
    from swarm_ctl.trust import provision
    from swarm_ctl.trust.names import KeyHolder, Role

    folder, now = tmp_path_factory.mktemp("trust"), datetime.now(UTC)
    terms = provision.Terms(now)
    agents = dict.fromkeys((1, 2, 3, 7), "127.0.0.1")
    for name in ("field", "other"):
        provision.new(folder / name, "field", agents, ["anna", "bob"], ["tv"], terms)
    shutil.copytree(folder / "field", folder / "old")
    provision.rotate(folder / "field", terms)
    past = provision.Terms(now - timedelta(days=40))
    provision.add(folder / "field", KeyHolder(Role.OPERATOR, "late"), "", past)
    return folder


def member(folder: Path, *, careless: bool = True) -> dict[str, Any]:
    """What a member tells zenoh; one who is `careless` lets everything through."""
    settings = access_settings(load_identity(folder), SWARM)
    if careless:
        del settings["access_control"]
    return settings


def settings_of(trust: Path, impostor: str) -> Mapping[str, Any] | None:
    """What each impostor tells zenoh on a mesh with keys."""
    if impostor == "plain TCP":
        return None
    if impostor == "no certificate":
        ca = {"root_ca_certificate": str(trust / "field/ca/ca.crt")}
        return {"transport/link/protocols": ["tls"], "transport/link/tls": ca}
    return member(
        trust
        / {
            "other CA": "other/operator-anna",
            "expired": "field/operator-late",
            "old epoch": "old/operator-anna",
            "viewer": "field/viewer-tv",
            "agent 7 on key 3": "field/agent-7",
            "operator bob as anna": "field/operator-bob",
        }[impostor]
    )


class Mesh:
    """Agent 1 and anna's station listen; agent 2 connects to them, and to all that listen."""

    def __init__(self, opened: ExitStack, settings: Callable[[str], Any]) -> None:
        self._opened = opened
        ports = free_ports(2 + len(IMPOSTORS), socket.SOCK_STREAM)
        self.listens, traps = (
            [f"tcp/127.0.0.1:{port}" for port in part] for part in (ports[:2], ports[2:])
        )
        first = self.join([self.listens[0]], [], settings("agent-1"))
        station = self.join([self.listens[1]], [self.listens[0]], settings("operator-anna"))
        second = self.join([], [*self.listens, *traps], settings("agent-2"))
        self.agents = {1: first, 2: second}
        self.traps = dict(zip(IMPOSTORS, traps, strict=True))
        self.inlets = [
            (channel.name, node.subscribe(channel.key_expression(SWARM)))
            for node in (first, station, second)
            for channel in CHANNELS
        ]

    def join(self, listen: list[str], connect: list[str], settings: Any) -> ZenohTransport:
        node = ZenohTransport(listen, connect, time.monotonic, access=settings)
        return self._opened.enter_context(closing(node))

    def words(self) -> Iterator[tuple[str, str]]:
        """Who said something, and on which channel."""
        for channel, inlet in self.inlets:
            for message in inlet.drain():
                yield bytes(message[-1]).decode(), channel


def attack(trust: Path, *, protected: bool) -> Deeds:
    """All impostors at once, beside an honest agent."""
    deeds = Deeds()
    with ExitStack() as opened:

        def honest(name: str) -> Any:
            return member(trust / "field" / name, careless=False) if protected else None

        mesh = Mesh(opened, honest)
        spies = {}
        for name in IMPOSTORS:
            settings = settings_of(trust, name) if protected else None
            # a server needs a certificate
            listen = [] if protected and name == "no certificate" else [mesh.traps[name]]
            spy = mesh.join(listen, mesh.listens, settings)
            spies[name] = spy, spy.subscribe(STATE.key_expression(SWARM))
        until = time.monotonic() + PATIENCE_S
        complete = False
        while time.monotonic() < until:
            for i, agent in mesh.agents.items():
                agent.publish(STATE.key(SWARM, i), b"honest", STATE.qos)
            for name, (spy, inlet) in spies.items():
                for channel in CHANNELS:
                    key = channel.key(SWARM, VICTIM[channel.publisher])
                    spy.publish(key, name.encode(), channel.qos)
                deeds.heard[name] += sum(bytes(m[-1]) == b"honest" for m in inlet.drain())
            for who, channel_name in mesh.words():
                deeds.told[who].add(channel_name)
            if not complete and deeds.complete(protected=protected):
                complete, until = True, time.monotonic() + (REFUSED_S if protected else 0.0)
            time.sleep(0.05)
    return deeds


@pytest.fixture(scope="module")
def on_open_mesh(trust: Path) -> Deeds:
    return attack(trust, protected=False)


@pytest.fixture(scope="module")
def on_mesh_with_keys(trust: Path) -> Deeds:
    deeds = attack(trust, protected=True)
    assert deeds.told["honest"] == {STATE.name}
    return deeds


@pytest.mark.parametrize("impostor", IMPOSTORS)
def test_an_impostor_is_heard_on_an_open_mesh_alone(
    impostor: str, on_open_mesh: Deeds, on_mesh_with_keys: Deeds
) -> None:
    """On every channel, as agent 3 or as a station of anna's."""
    assert on_open_mesh.told[impostor] == set(WORD)
    assert on_mesh_with_keys.told[impostor] == set()


@pytest.mark.parametrize("impostor", IMPOSTORS)
def test_a_stranger_hears_an_open_mesh_alone(
    impostor: str, on_open_mesh: Deeds, on_mesh_with_keys: Deeds
) -> None:
    """Members of the present epoch hear all; a stranger hears nothing."""
    assert on_open_mesh.heard[impostor] > 0
    assert (on_mesh_with_keys.heard[impostor] > 0) == (impostor in MEMBERS)


def until(condition: Callable[[], object]) -> None:
    """Poll until it holds."""
    ends = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.05)


@pytest.mark.parametrize("protected", [False, True])
def test_the_payload_of_agent_3_under_key_7(trust: Path, protected: bool) -> None:
    """On an open mesh agent 7 speaks for agent 3 under that key. With keys it can't: under its
    own key the payload is refused and counted."""

    def settings(name: str) -> Any:
        return member(trust / "field" / name) if protected else None

    (port,) = free_ports(1, socket.SOCK_STREAM)
    at = [f"tcp/127.0.0.1:{port}"]
    with (
        closing(ZenohTransport(at, [], time.monotonic, access=settings("agent-1"))) as ours,
        closing(ZenohTransport([], at, time.monotonic, access=settings("agent-7"))) as theirs,
    ):
        node = Node(ours, SWARM, 1)
        node.listen(STATE, agents=(1, 3, 7))
        taken: list[int] = []

        def forged_is_heard() -> bool:
            theirs.publish(STATE.key(SWARM, 7), encode(state(7)), STATE.qos)
            time.sleep(0.02)  # a link of the own host brings a state every 5 ms at most
            theirs.publish(STATE.key(SWARM, 7 if protected else 3), encode(state(3)), STATE.qos)
            taken.extend(payload.agent for payload, _ in node.take(STATE))
            return 7 in taken and (node.bad_payloads if protected else 3 in taken)

        until(forged_is_heard)
        assert set(taken) == ({7} if protected else {3, 7})


@pytest.mark.parametrize("protected", [False, True])
def test_no_agent_passes_a_command_on(trust: Path, protected: bool) -> None:
    """Agents route what a zenoh client says, so on an open mesh one endpoint reaches all. With keys
    agent 2 would hear it from agent 1, which may not speak for an operator: a command is heard on
    the operator's own link alone."""

    def settings(name: str) -> Any:
        return member(trust / "field" / name, careless=False) if protected else None

    ports = free_ports(2, socket.SOCK_STREAM)
    one, two = ([f"tcp/127.0.0.1:{port}"] for port in ports)
    config = configuration([], one, 1.0, patient=False, access=settings("operator-anna"))
    config.insert_json5("mode", '"client"')
    with (
        closing(ZenohTransport(one, [], time.monotonic, access=settings("agent-1"))) as first,
        closing(ZenohTransport(two, one, time.monotonic, access=settings("agent-2"))) as second,
        closing(zenoh.open(config)) as client,
    ):
        inlets = [node.subscribe(COMMAND.key_expression(SWARM)) for node in (first, second)]
        states = second.subscribe(STATE.key_expression(SWARM))
        heard, linked = [0, 0], [0]

        def all_is_heard() -> bool:
            client.put(COMMAND.key(SWARM, "anna.1-a"), b"kill")
            first.publish(STATE.key(SWARM, 1), b"honest", STATE.qos)
            linked[0] += len(states.drain())
            for k, inlet in enumerate(inlets):
                heard[k] += len(inlet.drain())
            return bool(linked[0] > 20 and heard[0] > 20 and (heard[1] > 20 or protected))

        until(all_is_heard)
        assert bool(heard[1]) is not protected


LISTENER: Final = """
import json, select, sys, time
from contextlib import closing
from pathlib import Path
from swarm_ctl.mesh.access import access_settings
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.engine.refused_links import RefusedLinks, reading_log
from swarm_ctl.trust.identity import load_identity

settings, links = access_settings(load_identity(Path(sys.argv[1])), "hexagon"), RefusedLinks()
with reading_log(links), closing(ZenohTransport(sys.argv[2:], [], time.monotonic, access=settings)):
    print("listening", flush=True)
    refused = ()
    while not refused and not select.select([sys.stdin], [], [], 0.02)[0]:
        refused = links.refused(0.0)
print(json.dumps([refusal.words for refusal in refused]))
"""
"""An agent's end of the mesh, which says what it refused as soon as it did, or its standard input
ends."""
REFUSED: Final = {
    "plain TCP": "a link: the other end speaks no TLS: it flies without trust, or is no agent",
    "no certificate": "a link: the other end has no certificate",
    "other CA": "a link: the other end does not trust our CA: it is of another swarm, or of old"
    " keys",
    "expired": "a link: the other end's certificate has expired, by this host's clock",
    "old epoch": "a link: the roster of this epoch does not name the other end",
    "agent-2": None,
}


@pytest.mark.parametrize("other", REFUSED)
def test_a_refused_link_is_told_with_its_reason(trust: Path, other: str) -> None:
    """By the agent that refuses it; a member's link is none. What else the process writes is
    seen."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    at, folder = f"tcp/127.0.0.1:{port}", trust / "field/agent-1"
    command = [sys.executable, "-c", LISTENER, str(folder), at]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    settings = member(trust / "field/agent-2") if other == "agent-2" else settings_of(trust, other)
    with subprocess.Popen(command, **pipes) as listener:
        assert listener.stdin is not None
        assert listener.stdout is not None
        assert listener.stdout.readline() == "listening\n"
        with closing(ZenohTransport([], [at], time.monotonic, access=settings)):
            if REFUSED[other] is None:
                time.sleep(REFUSED_S)
                listener.stdin.close()
            refused = json.loads(listener.stdout.readline())
    assert refused == ([REFUSED[other]] if REFUSED[other] else [])
