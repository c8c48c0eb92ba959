"""Settings for all tests: hypothesis without deadlines (no timed tests), the same examples on every CI run."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long runs only on demand: `pytest -m long`."""
    if not config.option.markexpr:
        items[:] = [item for item in items if "long" not in item.keywords]


settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")

pytest_plugins = ["swarm_ctl.testing.plugin"]  # known to pytest already where the package is installed anew
