"""What is installed: this package's version, and what a command needs beyond the core."""

from __future__ import annotations

import re
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Final

from swarm_ctl.errors import StartError

ONLY_FASTER: Final = {"numba"}
"""Packages without which a command does the same, and says that it is slower."""


def version() -> str:
    """Of this package, as `pip` knows it."""
    try:
        return metadata.version("swarm-ctl")
    except metadata.PackageNotFoundError:
        return "0+unknown"  # a source tree that is not installed


def commit() -> str:
    """What this package was built of, or the commit of the checkout that it runs from: twelve
    digits, with `+` where files were changed; '' where neither is known."""
    package = Path(__file__).parent
    kept, root = package / "commit.txt", package.parent
    if kept.exists():
        told = kept.read_text()
    elif (root / ".git").exists():
        words = ("describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+")
        git = ["git", "-C", str(root), *words]
        try:
            told = subprocess.run(git, capture_output=True, text=True, check=False).stdout
        except FileNotFoundError:
            return ""
    else:
        return ""
    found = re.fullmatch(r"([0-9a-f]{12})[0-9a-f]*(\+?)", told.strip())
    return f"{found[1]}{found[2]}" if found else ""


def require(extra: str, what: str) -> None:
    """Raise StartError where a package of this extra is not installed; `what` needs it."""
    needed = [name for name in packages(extra) if name not in ONLY_FASTER]
    missing = [name for name in needed if not _installed(name)]
    if missing:
        raise StartError(
            f"{what} needs {', '.join(missing)}; install with: pip install 'swarm-ctl[{extra}]'"
        )


def packages(extra: str) -> list[str]:
    """The packages that an extra adds, '': those of the core; none in a source tree that is not
    installed."""
    try:
        requirements = metadata.requires("swarm-ctl") or []
    except metadata.PackageNotFoundError:
        return []
    marker = re.compile(rf"extra == ['\"]{extra}['\"]" if extra else r"^[^;]*$")
    return [
        re.split(r"[^\w.-]", text, maxsplit=1)[0] for text in requirements if marker.search(text)
    ]


def _installed(package: str) -> bool:
    try:
        metadata.distribution(package)
    except metadata.PackageNotFoundError:
        return False
    return True
