"""The logs that a host has sent."""

from __future__ import annotations

import io
import re
import tarfile
from pathlib import Path
from typing import Final

from swarm_ctl.errors import InputError
from swarm_ctl.files import replacing

_LOG: Final = re.compile(r"[0-9]{8}-[0-9]{6}/(agent-[0-9]{1,5}|router)\.(log|tlog|json)")


def unpack_logs(data: bytes, folder: Path) -> list[Path]:
    """Write the files of a tar that `Host.logs` made; InputError where it holds anything else, and
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
