"""Logs on their way from a host to the ground, as a tar."""

from __future__ import annotations

import os
import re
import tarfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Final

from swarm_ctl.archives import plain_files
from swarm_ctl.errors import InputError
from swarm_ctl.files import replacing

MOST_BYTES: Final = 1_000_000_000
"""Of one host's logs, all its flights together."""
_LOG: Final = re.compile(r"[0-9]{8}-[0-9]{6}/(agent-[0-9]{1,5}|router)\.(log|tlog|json)")


def pack_logs(flights: Iterable[Path], out: IO[bytes]) -> None:
    """Write the files of these flights' folders as they are now: agents may write on."""
    with tarfile.open(fileobj=out, mode="w|", format=tarfile.USTAR_FORMAT) as archive:
        for folder in (folder for folder in flights if folder.is_dir()):
            for path in sorted(folder.iterdir()):
                if path.is_file() and not path.is_symlink():
                    _add(archive, path, f"{folder.name}/{path.name}")


def unpack_logs(tar: IO[bytes], folder: Path) -> list[Path]:
    """Write the files of a tar that `pack_logs` made; InputError where it holds anything else, or
    more than `MOST_BYTES`, and then nothing more is written."""
    written = []
    try:
        for name, content in plain_files(tar, MOST_BYTES):
            if _LOG.fullmatch(name) is None:
                raise InputError(f"{folder.name} sent {name!r}; allowed: logs")
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as file:
                file.write(content)
            written.append(path)
    except tarfile.TarError as error:
        raise InputError(f"{folder.name} sent no logs: {error}; allowed: a tar of logs") from None
    return written


def last_line(log: Path) -> str:
    """What a process has said last; '' where it has said nothing."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - 2000))
            lines = file.read().decode(errors="replace").split("\n")
    except FileNotFoundError:
        return ""
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def _add(archive: tarfile.TarFile, path: Path, name: str) -> None:
    """As much of a file as is there now: an agent may write it on."""
    with path.open("rb") as file:
        entry = tarfile.TarInfo(name)
        found = os.fstat(file.fileno())
        entry.size, entry.mtime, entry.mode = found.st_size, int(found.st_mtime), 0o644
        archive.addfile(entry, file)
