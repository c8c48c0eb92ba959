"""The truth file: what really happened, one JSON object a line, each written at once so that a kill loses nothing."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


class TruthFile:
    """Writes lines to `path` without buffering."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)

    def write(self, line: dict[str, Any]) -> None:
        """One object, one line, one system call."""
        os.write(self._fd, json.dumps(line, separators=(",", ":")).encode() + b"\n")

    def close(self) -> None:
        """No more lines."""
        os.close(self._fd)
