"""Rows of a test that fly with `python -m pytest -m long` alone."""

from __future__ import annotations

from typing import Any

import pytest


def on_demand(*row: object) -> Any:
    """The row's arguments; another row shows the same, or contains it."""
    return pytest.param(*row, marks=pytest.mark.long)
