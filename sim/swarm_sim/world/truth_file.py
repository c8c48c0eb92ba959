"""The truth file: a JSON object a line, written at once so that a killed simulator loses none."""

from __future__ import annotations

import errno
import itertools
import json
import logging
import os
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)


class TruthFile:
    """Writes lines to `path` without buffering. A full disk ends the file, not the flight. An older
    file of that name is kept, with a number before its suffix."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file() and path.stat().st_size:
            numbered = (path.with_suffix(f".{k}{path.suffix}") for k in itertools.count(1))
            path.rename(next(each for each in numbered if not each.exists()))
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        self.failure = ""
        """Why it has ended early."""

    def write(self, line: dict[str, Any]) -> None:
        """One object, one line, one system call."""
        if self.failure:
            return
        data = json.dumps(line, separators=(",", ":")).encode() + b"\n"
        try:
            if os.write(self._fd, data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            self.failure = error.strerror or str(error)
            log.warning("the truth file ends here: %s; flying on", self.failure)

    def close(self) -> None:
        os.close(self._fd)
