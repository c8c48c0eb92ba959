"""The ready missions: in `missions/` of the source tree, and inside the installed package."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from swarm_ctl.errors import InputError

_PACKAGE: Final = Path(__file__).parents[1]
_FOLDERS: Final = (_PACKAGE / "ready_missions", _PACKAGE.parent / "missions")
"""Of a wheel, and of the source tree."""


def ready_missions() -> dict[str, Path]:
    """The file of each ready mission, by name."""
    folder = next((each for each in _FOLDERS if each.is_dir()), _FOLDERS[0])
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def ready_mission(name: str) -> Path:
    """The file of one ready mission; InputError where there is none of this name."""
    known = ready_missions()
    if name not in known:
        raise InputError(f"{name}: no such file or ready mission; allowed: {', '.join(known)}")
    return known[name]


def shows(mission: Path) -> str:
    """What a ready mission shows: the first sentence of the comment at its top."""
    words: list[str] = []
    for line in mission.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#") or line == "#":
            break
        if not line.startswith("# yaml-language-server"):
            words.append(line.removeprefix("#").strip())
    return " ".join(words).partition(". ")[0].removesuffix(".")


def named(mission: Path) -> Path:
    """A mission as a user names it: a file, or a ready mission's name (`hexagon`).

    Raises:
        InputError: a name without a suffix or a folder is neither, or a file that has a ready
            mission's name is not there.
    """
    if mission.suffix == ".yaml" and not mission.exists() and mission.stem in ready_missions():
        name = mission.stem
        copy = f"a copy of it (swarm-ctl missions copy {name})"
        raise InputError(f"{mission}: no such file; allowed: {name}, the ready mission, or {copy}")
    is_name = mission.suffix == "" and len(mission.parts) == 1
    return ready_mission(mission.name) if is_name and not mission.exists() else mission
