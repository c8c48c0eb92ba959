"""The one whole flight, at which all programs of others look, too."""

from __future__ import annotations

import shutil
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest

from tests.scenarios.swarm import low_hexagon_text
from tests.system.running import Running

if TYPE_CHECKING:
    from tests.foreign.foxglove_client import FoxgloveClient


class Flight(NamedTuple):
    """A flight of six agents in lockstep that has ended."""

    code: int
    stdout: str
    stderr: str
    cwd: Path
    folder: Path
    """With recording, logs, report and `junit.xml`."""
    client: FoxgloveClient | None
    """Has watched it; None where the extra `foxglove` is not installed."""


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flight]:
    """Flown once for all files, with JSON lines on stdout."""
    cwd, client = tmp_path_factory.mktemp("foreign"), None
    (cwd / "hexagon.yaml").write_text(low_hexagon_text())
    fly = ["run", "hexagon.yaml", "--lockstep", "--json", "--junit", "junit.xml"]
    with ExitStack() as opened:
        if find_spec("foxglove") is None:
            running = opened.enter_context(Running(*fly, cwd=cwd, stderr=True))
        else:
            from tests.foreign.foxglove_client import FoxgloveClient

            port = str(_free_port())
            running = Running(*fly, "--foxglove", port, cwd=cwd, stderr=True)
            opened.enter_context(running)
            client = opened.enter_context(FoxgloveClient(int(port)))
            assert not client.listen(lambda: False, seconds=120.0)
        code = running.wait()
        running.assert_nothing_left()
        told = (code, running.output, running.errors, cwd)
        assert code == 0, told
        shutil.move(cwd / "junit.xml", running.folder)
        yield Flight(*told, running.folder, client)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
