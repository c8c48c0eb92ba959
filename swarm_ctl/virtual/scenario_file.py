"""What tells a scenario's file from a mission's, before either is read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from swarm_ctl.files import read_bytes

_MOST: Final = 10_000_000
_MISSION: Final = re.compile(rb"^[\"']?mission[\"']?\s*:", re.MULTILINE)


def is_scenario(path: Path) -> bool:
    """It names a mission, which no mission does."""
    return path.is_file() and says_scenario(read_bytes(path, _MOST))


def says_scenario(text: bytes) -> bool:
    """As `is_scenario`, of a text."""
    return _MISSION.search(text) is not None
