"""Logs on their way from a host to the ground, as a tar."""

from __future__ import annotations

import io
import os
import re
import tarfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Final

from swarm_ctl.errors import InputError
from swarm_ctl.files import replacing

_LOG: Final = re.compile(r"[0-9]{8}-[0-9]{6}/(agent-[0-9]{1,5}|router)\.(log|tlog|json)")


def pack_logs(flights: Iterable[Path], out: IO[bytes]) -> None:
    """Write the files of these flights' folders as they are now: agents may write on."""
    with tarfile.open(fileobj=out, mode="w|") as archive:
        for folder in (folder for folder in flights if folder.is_dir()):
            for path in sorted(folder.iterdir()):
                if path.is_file() and not path.is_symlink():
                    _add(archive, path, f"{folder.name}/{path.name}")


def unpack_logs(data: bytes, folder: Path) -> list[Path]:
    """Write the files of a tar that `pack_logs` made; InputError where it holds anything else, and
    then nothing more is written."""
    written = []
    try:
        with tarfile.open(fileobj=io.BytesIO(data), mode="r:") as archive:
            for entry in archive:
                if _LOG.fullmatch(entry.name) is None or not entry.isreg():
                    raise InputError(f"{folder.name} sent {entry.name!r}; allowed: logs")
                path, content = folder / entry.name, archive.extractfile(entry)
                path.parent.mkdir(parents=True, exist_ok=True)
                with replacing(path) as file:
                    file.write(content.read() if content else b"")
                written.append(path)
    except tarfile.TarError as error:
        raise InputError(f"{folder.name} sent no logs: {error}") from None
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
        entry.size, entry.mtime, entry.mode = found.st_size, found.st_mtime, 0o644
        archive.addfile(entry, file)
