"""The extension of the guide, as an installed package at a station."""

from __future__ import annotations

import importlib
import socket
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.errors import InputError
from swarm_ctl.extension import check
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from tests.unit.docs.pages import PAGES, blocks
from tests.unit.report.run_folders import PLAN
from tests.unit.station.pictures import PICTURES

CODE, ABOUT, ORDERING = (
    block.text for block in blocks(PAGES["extensions"]) if block.language in ("python", "toml")
)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The package as `pip` leaves it; the extension's name."""
    project = tomllib.loads(ABOUT)["project"]
    ((group, points),) = project["entry-points"].items()
    ((name, value),) = points.items()
    (tmp_path / f"{value.partition(':')[0]}.py").write_text(CODE)
    folder = tmp_path / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    (folder / "entry_points.txt").write_text(f"[{group}]\n{name} = {value}\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    yield name
    sys.modules.pop(value.partition(":")[0], None)


def a_station(hub: MemoryHub) -> Station:
    node = Node(MemoryTransport(hub), "swarm", "station")
    return Station(PLAN, node, SimpleNamespace(stepped=False, speedup=1.0, now=lambda: 1.0))


def test_alarms_come_as_lines(installed: str) -> None:
    """One as it begins, one as it ends; what is no port is refused before the flight."""
    with pytest.raises(InputError, match="alarm-lines=x; allowed: alarm-lines=PORT"):
        check([f"{installed}=x"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(20.0)
        station = a_station(MemoryHub(lambda: 1.0))
        word = f"{installed}={receiver.getsockname()[1]}"
        check([word])
        with Attachments([word], station) as attached:
            attached.show(PICTURES["lost"]())
            lines = [receiver.recv(1000).decode()]
            attached.show(PICTURES["well"]())
            while lines[-1] != "30.0 over: silent\n":
                lines.append(receiver.recv(1000).decode())
        assert station.troubles() == []
    assert "34.0 agent 3: not heard for 4.2 s\n" in lines


def test_an_order_of_the_page_is_sent(installed: str) -> None:
    """Its lines run in an extension as they stand."""
    hub = MemoryHub(lambda: 1.0)
    agent = Node(MemoryTransport(hub), "swarm", 2)
    agent.listen(keys.COMMAND)
    with Attachments([f"{installed}=9"], a_station(hub)) as attached:
        exec(ORDERING, {"station": attached._all[0]._handle})  # noqa: S102
        attached.turn()
        ((command, _),) = agent.take(keys.COMMAND)
    assert (command.kind, command.agents) == ("hold", (2,))
