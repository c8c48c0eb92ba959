"""The one file that goes to a host: a tar of a member's folder. A bundle may be hostile: each
entry's name, kind and size is checked before its content is read."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path
from typing import Final

from swarm_ctl.archives import packed, plain_files
from swarm_ctl.errors import TrustError
from swarm_ctl.trust import identity
from swarm_ctl.trust.files import (
    changed_folder,
    new_folder,
    read_guarded,
    read_plain,
    write_private,
)
from swarm_ctl.trust.identity import Identity, load_identity, load_member
from swarm_ctl.trust.names import KeyHolder, member_of
from swarm_ctl.trust.roster import ROSTER, SEAL, parse, read_roster

_NEEDED: Final = (identity.CERTIFICATE, identity.CA, ROSTER, SEAL)
_FILES: Final = (*_NEEDED, identity.KEY, identity.MAVLINK_KEY)


def pack(folder: Path) -> bytes:
    """The bundle of a member's folder. Without a private key where it stays on its host."""
    there = (folder / name for name in _FILES if (folder / name).exists())
    return packed((f"{folder.name}/{path.name}", read_guarded(path)) for path in there)


def unpacked(bundle: Path) -> tuple[KeyHolder, dict[str, bytes]]:
    """The member and the files of a bundle; TrustError where it holds anything else."""
    files: dict[str, bytes] = {}
    members: set[str] = set()
    data = read_plain(bundle)
    try:
        for entry, content in plain_files(io.BytesIO(data), len(data)):
            folder, _, name = entry.partition("/")
            if name not in _FILES or name in files:
                raise TrustError(
                    f"{bundle}: holds {entry!r}; allowed: each of {', '.join(_FILES)}"
                    " once, in a folder such as agent-3"
                )
            members.add(folder)
            files[name] = content
    except tarfile.TarError as error:
        raise TrustError(f"{bundle}: is no bundle: {error}") from None
    missing = [name for name in _NEEDED if name not in files]
    if missing or len(members) != 1:
        raise TrustError(
            f"{bundle}: is of {len(members)} members and without {', '.join(missing) or 'nothing'};"
            " allowed: a bundle that `swarm-ctl trust` made"
        )
    return member_of(members.pop()), files


def install(bundle: Path, trust: Path | None = None) -> Identity:
    """Put a bundle's folder into the trust folder of this host, or its files into the folder that
    is there (which keeps its private key where the bundle has none, and its stamp). Without a trust
    folder: `trust/SWARM`.

    Raises:
        TrustError: the bundle holds anything that it should not, its parts do not fit each other,
            the folder is another swarm's, or has a newer roster. Nothing was changed.
    """
    member, files = unpacked(bundle)
    trust = trust or Path("trust") / parse(files[ROSTER], bundle).swarm
    folder = trust / member.folder
    if not folder.exists():
        if identity.KEY not in files:
            raise TrustError(
                f"{bundle}: has no private key, and {folder} is not there; allowed: on the host"
                f" that made the key (`swarm-ctl trust request {member}`)"
            )
        trust.mkdir(mode=0o700, parents=True, exist_ok=True)
        with new_folder(folder) as made:
            _put(files, made, folder, member)
    else:
        with changed_folder(folder) as made:
            _put(files, made, folder, member)
    return load_identity(folder)


def _put(files: dict[str, bytes], made: Path, folder: Path, member: KeyHolder) -> None:
    before = made / identity.CA
    roster = read_roster(made, before) if before.exists() else None
    if roster is not None and read_guarded(before) != files[identity.CA]:
        raise TrustError(
            f"{folder}: is of another CA; allowed: a bundle of swarm {roster.swarm}, or remove the"
            " folder first"
        )
    for name, data in files.items():
        write_private(made / name, data)
    try:
        installed = load_member(made, member)
    except TrustError as error:
        raise TrustError(str(error).replace(str(made), str(folder))) from None
    if roster is not None and installed.epoch < roster.epoch:
        raise TrustError(
            f"{folder}: has the roster of epoch {roster.epoch}, and the bundle's is of epoch"
            f" {installed.epoch}; allowed: the newest bundle"
        )
