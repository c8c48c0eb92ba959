"""Impostors on the mesh, with real zenoh sessions. On an open mesh each of them is heard on every
channel, and hears; on a mesh with keys none is, whichever end opens the link."""

from __future__ import annotations

import shutil
import socket
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import pytest

from swarm_ctl.mesh.access import access_settings
from swarm_ctl.mesh.keys import CHANNELS, STATE
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.runtime.launch.ports import free_ports
from swarm_ctl.trust.identity import load_identity

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
    from swarm_ctl.trust.names import Member, Role

    folder, now = tmp_path_factory.mktemp("trust"), datetime.now(UTC)
    terms = provision.Terms(now)
    agents = dict.fromkeys((1, 2, 3, 7), "127.0.0.1")
    for name in ("field", "other"):
        provision.new(folder / name, "field", agents, ["anna", "bob"], ["tv"], terms)
    shutil.copytree(folder / "field", folder / "old")
    provision.rotate(folder / "field", terms)
    past = provision.Terms(now - timedelta(days=40))
    provision.add(folder / "field", Member(Role.OPERATOR, "late"), "", past)
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
