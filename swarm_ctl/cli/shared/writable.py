"""Asks before the work whether its result can be written."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

from swarm_ctl.errors import StartError


def require_writable(path: Path, choose: str) -> None:
    """Raise StartError where neither a file `path` nor a folder of this name can be written, or
    made with the folders that it needs; `choose` says how to name another place."""
    try:
        there = next(each for each in (path, *path.parents) if each.exists())
        if there.is_dir():
            with tempfile.TemporaryFile(dir=there):
                return
        if there != path:
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        with path.open("ab"):
            return
    except OSError as error:
        raise StartError(f"{path}: can't be written: {error.strerror}; {choose}") from None
