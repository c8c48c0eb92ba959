"""Rows on ArduCopter and PX4 themselves: each has the marker `autopilot`, and is skipped with the
reason where its programs are not found (`swarm-ctl run --help` says how they are).

`python -m pytest` flies a few; all: `python -m pytest -m autopilot`.
"""

from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A folder's conftest is asked about all items: mark ours."""
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.autopilot)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(400))
