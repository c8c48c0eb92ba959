"""One trust folder for all tests that only read, and copies for those that change it."""

from __future__ import annotations

import os
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from swarm_ctl.trust.provision import Terms, new

NOW = datetime.now(UTC)


@pytest.fixture(autouse=True)
def fast_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test here ends by a power failure: nothing waits for the disk."""
    monkeypatch.setattr(os, "sync", lambda: None)


@pytest.fixture(scope="package")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The trust folder of three agents, an operator and a viewer. Do not change it."""
    folder = tmp_path_factory.mktemp("made") / "outdoors"
    agents = {1: "127.0.0.1", 2: "127.0.0.1", 3: "192.168.1.13"}
    new(folder, "outdoors", agents, ["anna"], ["tv"], Terms(NOW))
    return folder


@pytest.fixture
def trust(made: Path, tmp_path: Path) -> Path:
    """A copy of the trust folder."""
    return shutil.copytree(made, tmp_path / "outdoors")
