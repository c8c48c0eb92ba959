"""The one flight that all programs of others look at."""

from __future__ import annotations

import shutil
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest

from tests.system.running import LOW, Running

if TYPE_CHECKING:
    from tests.foreign.foxglove_client import FoxgloveClient


class Flight(NamedTuple):
    """A flight of three agents in lockstep that has ended."""

    folder: Path
    """With recording, logs, report and `junit.xml`."""
    client: FoxgloveClient | None
    """Has watched it; None where the extra `foxglove` is not installed."""


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flight]:
    """Flown once for all files."""
    cwd, client = tmp_path_factory.mktemp("foreign"), None
    fly = ["run", LOW, "--lockstep", "--headless", "--junit", "junit.xml"]
    with ExitStack() as opened:
        if find_spec("foxglove") is None:
            running = opened.enter_context(Running(*fly, cwd=cwd))
        else:
            from tests.foreign.foxglove_client import FoxgloveClient

            port = _free_port()
            running = opened.enter_context(Running(*fly, "--foxglove", str(port), cwd=cwd))
            client = opened.enter_context(FoxgloveClient(port))
            assert not client.listen(lambda: False, seconds=120.0)
        assert running.wait() == 0, running.output
        running.assert_nothing_left()
        shutil.move(cwd / "junit.xml", running.folder)
        yield Flight(running.folder, client)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
