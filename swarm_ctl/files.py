"""Files that others may have made, read with bounds; files of ours, written whole, through no link.

A run folder, a mission or a plan may come from a stranger: a name in it may be a link, a FIFO, a
device, or a file of any size.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

if sys.platform != "win32":
    import fcntl

_AT_ONCE: Final = getattr(os, "O_NONBLOCK", 0)


def open_regular(path: Path) -> IO[bytes]:
    """The file, open for reading. It never waits, as opening a FIFO does.

    Raises:
        OSError: it can't be opened, or is no regular file; `strerror` says which.
    """
    try:
        found = path.stat()
    except ValueError as error:  # NUL, or half of a surrogate pair
        what = "has a character in its name that no file has"
        raise OSError(errno.EINVAL, what, str(path)) from error
    _require_regular(path, found)  # before it is opened: a device may act on that
    file = open(path, "rb", opener=_at_once)  # noqa: SIM115 - the caller closes it
    try:
        _require_regular(path, os.fstat(file.fileno()))
    except OSError:
        file.close()
        raise
    return file


def read_bytes(path: Path, most: int) -> bytes:
    """All of a regular file of at most `most` bytes; OSError as `open_regular`, or where the file
    is larger."""
    with open_regular(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"is larger than {most / 1e6:g} MB", str(path))
    return data


@contextlib.contextmanager
def replacing(path: Path, mode: int = 0o666, *, durable: bool = False) -> Iterator[IO[bytes]]:
    """A new file that takes the place of `path` in one move when the block ends well, and else is
    removed: no reader finds a part of it, and a link at `path` is replaced, not followed.

    Args:
        path: its folder is there.
        mode: permissions, less the umask, where `path` is no regular file yet; else they stay.
        durable: the new file is on the disk when the block has ended.

    Raises:
        OSError: it can't be written, or `path` is a folder; `filename` is `path`.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    part = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    with named(path, part):
        descriptor = os.open(part, flags, mode)
        try:
            with os.fdopen(descriptor, "wb") as file:
                yield file
                _keep_mode(path, file.fileno())
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    if durable:
        _sync_folder(path.parent)


@contextlib.contextmanager
def named(path: Path, part: Path | None = None) -> Iterator[None]:
    """An OSError inside that names no file, as that of a write on a full disk, or only `part`,
    names `path`."""
    try:
        yield
    except OSError as error:
        if error.filename not in (None, part and str(part)):
            raise
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None


def append_line(path: Path, line: str) -> None:
    """Add a line to a file, after one that was cut off, too; an OSError names it."""
    with named(path), path.open("a+b") as file:
        begins = ""
        if end := file.tell():
            file.seek(end - 1)
            begins = "" if file.read(1) == b"\n" else "\n"
        file.write(f"{begins}{line}\n".encode())


def locked(descriptor: int, *, shared: bool = False) -> bool:
    """Lock an open file or folder until it is closed; False where another process has locked it, or
    the system has no such locks (Windows)."""
    if sys.platform != "win32":
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
            return True
    return False


def _at_once(path: str, flags: int) -> int:
    return os.open(path, flags | _AT_ONCE)


def _keep_mode(path: Path, descriptor: int) -> None:
    with contextlib.suppress(FileNotFoundError):
        there = path.lstat()
        if stat.S_ISREG(there.st_mode) and sys.platform != "win32":
            os.fchmod(descriptor, there.st_mode & 0o777)


def _sync_folder(folder: Path) -> None:
    if sys.platform == "win32":
        return  # a folder can't be opened there
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _require_regular(path: Path, found: os.stat_result) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "is no regular file", str(path))
