"""Files with secrets: never readable by others, not for a moment, and written whole or not at
all."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from swarm_ctl.errors import TrustError
from swarm_ctl.files import locked, open_regular, replacing

_LARGEST: Final = 1 << 20


def access_fault(path: Path, found: os.stat_result) -> str | None:
    """What is wrong with the mode or the owner of a file or folder of the trust."""
    allowed = "0700" if stat.S_ISDIR(found.st_mode) else "0600"
    mode = stat.S_IMODE(found.st_mode)
    if mode & 0o077:
        return (
            f"{path}: others may read or write it (mode {mode:04o});"
            f" allowed: {allowed}, as by: chmod {allowed} {path}"
        )
    if found.st_uid not in (os.geteuid(), 0) and os.geteuid() != 0:
        return f"{path}: belongs to user {found.st_uid}; allowed: this user's ({os.geteuid()})"
    return None


@contextlib.contextmanager
def readable(path: Path) -> Iterator[None]:
    """An error of the system becomes a TrustError."""
    try:
        yield
    except OSError as error:
        raise TrustError(f"{path}: can't be read: {error.strerror}") from None


def read_guarded(path: Path) -> bytes:
    """The bytes of a file of the trust; TrustError where it is missing, no file, too large, or
    others may read it."""
    return _read(path, guarded=True)


def read_plain(path: Path) -> bytes:
    """The bytes of a file that is no secret, or that came from elsewhere; TrustError where it is
    missing, no file, or too large."""
    return _read(path, guarded=False)


def _read(path: Path, *, guarded: bool) -> bytes:
    with readable(path), open_regular(path) as file:
        fault = access_fault(path, os.fstat(file.fileno())) if guarded else None
        if fault:
            raise TrustError(fault)
        data = file.read(_LARGEST + 1)
    if len(data) > _LARGEST:
        raise TrustError(f"{path}: is too large; allowed: at most {_LARGEST} bytes")
    return data


def guard(folder: Path) -> None:
    """TrustError where a folder of the trust is missing, or others may read it."""
    with readable(folder):
        found = folder.stat()
    if not stat.S_ISDIR(found.st_mode):
        raise TrustError(f"{folder}: is no folder; allowed: a folder that `trust` made")
    fault = access_fault(folder, found)
    if fault:
        raise TrustError(fault)


def write_private(path: Path, data: bytes) -> None:
    """Write a file of mode 0600, whole or not at all."""
    with replacing(path, 0o600) as file:
        file.write(data)


@contextlib.contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """An empty folder beside `folder`, of mode 0700, which takes its place at the end, or goes.
    TrustError where `folder` is there already."""
    if folder.exists():
        raise TrustError(f"{folder}: is there already; allowed: a folder that is not there yet")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _beside(folder) as made:
        yield made
        os.sync()  # once for all files: a power failure leaves the old folder or the new one
        made.rename(folder)  # fails where another process was faster


@contextlib.contextmanager
def changed_folder(folder: Path) -> Iterator[Path]:
    """A copy of `folder`, which takes its place at the end, or goes. TrustError where another
    process changes it now."""
    guard(folder)
    with _locked(folder), _beside(folder) as made:
        hidden = shutil.ignore_patterns(".*.*")  # what another process writes at this moment
        shutil.copytree(folder, made, dirs_exist_ok=True, copy_function=_copy, ignore=hidden)
        yield made
        os.sync()
        with _beside(folder) as old:
            folder.rename(old)
            try:
                made.rename(folder)
            except BaseException:
                old.rename(folder)  # else it would go with what is removed at the end
                raise


@contextlib.contextmanager
def _beside(folder: Path) -> Iterator[Path]:
    made = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))  # is 0700
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        if not locked(descriptor):
            raise TrustError(f"{folder}: another process changes it now; try again")
        yield
    finally:
        os.close(descriptor)


def _copy(source: str, to: str) -> None:
    write_private(Path(to), Path(source).read_bytes())
