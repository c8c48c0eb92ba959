"""Settings for all tests, and how they share a machine of two cores.

Tests in real time (processes, sockets, the system's clock) mostly wait, and must not be kept
waiting. The two folders of them are a group each, so that one worker flies them one after another;
the groups are the largest, so they are what the workers begin with. All other tests only compute:
they come after, and a worker that has come to them gives way.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

REALTIME = ("system", "protocol")
_GIVE_WAY = 10


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups and pytest its -m
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long runs only on demand: `pytest -m long`. Tests in real time get their group."""
    if not config.option.markexpr:
        items[:] = [item for item in items if "long" not in item.keywords]
    for item in items:
        group = _group(item)
        if group:
            item.add_marker(pytest.mark.realtime)
            item.add_marker(pytest.mark.xdist_group(group))


def _group(item: pytest.Item) -> str:
    folder = item.path.relative_to(Path(__file__).parent).parts[0]
    return folder if folder in REALTIME else REALTIME[0] if "realtime" in item.keywords else ""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A worker beside another one gives way to flights from its first test that only computes."""
    beside_another = "PYTEST_XDIST_WORKER" in os.environ
    if beside_another and "realtime" not in item.keywords and os.nice(0) < _GIVE_WAY:
        os.nice(_GIVE_WAY - os.nice(0))


settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")

pytest_plugins = [
    "swarm_ctl.testing.plugin"
]  # known to pytest already where the package is installed anew
