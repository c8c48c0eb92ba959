"""One member opens links without end: it gets a few, is named, and keeps nobody away."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import pytest

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh import zenoh_config
from swarm_ctl.mesh.access import access_settings
from swarm_ctl.mesh.keys import COMMAND
from swarm_ctl.mesh.links import OF_A_NAME
from swarm_ctl.mesh.zenoh_config import MeshPart
from swarm_ctl.mesh.zenoh_transport import Router, ZenohTransport
from swarm_ctl.trust import provision
from swarm_ctl.trust.identity import load_identity
from tests.security.test_impostors import SWARM, until

pytestmark = pytest.mark.realtime
SESSIONS: Final = 24


@pytest.mark.parametrize("part", ["agent", "router"])
def test_a_viewer_takes_few_links_and_a_new_operator_is_heard(
    part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More sessions than there are places in all, which are 20 here; each that is ended comes again
    at once."""
    monkeypatch.setattr(zenoh_config, "_SESSIONS", 20)
    terms = provision.Terms(datetime.now(UTC))
    hosts, folder = {1: "127.0.0.1"}, tmp_path / SWARM
    provision.new(folder, SWARM, hosts, ["anna"], ["tv"], terms, ["127.0.0.1"])
    at = f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"

    def keys(member: str) -> dict[str, object]:
        return access_settings(load_identity(folder / member), SWARM)

    with ExitStack() as opened:

        def peer(member: str, listen: list[str], connect: list[str]) -> ZenohTransport:
            kind = MeshPart.CLIENT if part == "router" else MeshPart.PEER
            made = ZenohTransport(listen, connect, time.monotonic, access=keys(member), part=kind)
            return opened.enter_context(closing(made))

        if part == "router":
            served: Router | ZenohTransport = opened.enter_context(
                closing(Router([at], [], access=keys("router-1")))
            )
            agent = peer("agent-1", [], [at])
        else:
            served = agent = peer("agent-1", [at], [])
        inlet = agent.subscribe(COMMAND.key_expression(SWARM))
        for _ in range(SESSIONS):
            peer("viewer-tv", [], [at])
        operator = peer("operator-anna", [], [at])

        def heard() -> bool:
            operator.publish(COMMAND.key(SWARM, "anna.1-a"), b"{}", COMMAND.qos)
            time.sleep(0.1)
            return bool(inlet.drain())

        until(heard)
        (told,) = served.refused(1.0)
        assert told.words == (
            f"a link: viewer-tv.{SWARM}.e1 has {OF_A_NAME} already,"
            " which is all that a member may have"
        )
        assert told.count >= SESSIONS - OF_A_NAME
