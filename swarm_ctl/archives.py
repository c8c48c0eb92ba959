"""Tars of ours, and those of strangers, of which plain files alone are read, with bounds.

A tar may say that an entry is a link, a device, or a file with holes that is a million times as
large as the tar. So only the headers are tarfile's here: a header of any other kind ends the
reading, and no content is read that is larger than what is left of the bound.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterable, Iterator
from typing import IO, Final

_BLOCK: Final = tarfile.BLOCKSIZE
_PLAIN: Final = (tarfile.REGTYPE, tarfile.AREGTYPE)
_MOST_ENTRIES: Final = 100_000


def packed(files: Iterable[tuple[str, bytes]]) -> bytes:
    """The tar of these files by name, each of mode 0600: the same bytes of the same files."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:", format=tarfile.USTAR_FORMAT) as archive:
        for name, data in files:
            entry = tarfile.TarInfo(name)
            entry.size, entry.mode = len(data), 0o600
            archive.addfile(entry, io.BytesIO(data))
    return out.getvalue()


def plain_files(file: IO[bytes], most: int) -> Iterator[tuple[str, bytes]]:
    """Name and content of each entry of an uncompressed tar, as it is read.

    Args:
        file: of a tar; what stands behind its end is not read.
        most: bytes of all contents together.

    Raises:
        tarfile.TarError: it is no tar, is torn, holds anything but plain files, holds a name twice,
            or more than `most` bytes.
    """
    seen: set[str] = set()
    left = most
    while (header := _whole(file, _BLOCK)) != bytes(_BLOCK):
        entry = tarfile.TarInfo.frombuf(header, "ascii", "surrogateescape")
        if entry.type not in _PLAIN:
            raise tarfile.ReadError(f"holds {entry.name!r}, which is no plain file")
        if entry.name in seen:
            raise tarfile.ReadError(f"holds {entry.name!r} twice")
        if len(seen) >= _MOST_ENTRIES:
            raise tarfile.ReadError(f"holds more than {_MOST_ENTRIES} files")
        if not 0 <= entry.size <= left:
            raise tarfile.ReadError(f"holds more than {most / 1e6:g} MB ({entry.name!r})")
        seen.add(entry.name)
        left -= entry.size
        data = _whole(file, entry.size)
        _whole(file, -entry.size % _BLOCK)
        yield entry.name, data


def _whole(file: IO[bytes], size: int) -> bytes:
    data = file.read(size)
    if len(data) < size:
        raise tarfile.ReadError("is torn, or no tar")
    return data
