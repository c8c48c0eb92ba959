"""What the tests read of the project's documents: texts, fenced blocks, files to save."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[3]
DOCS: Final = ROOT / "docs"
PAGES: Final = {path.stem: path for path in sorted(DOCS.rglob("*.md"))}
"""The site's pages by name: no two have the same, in whatever folder they are."""
DOCUMENTS: Final = (
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "missions" / "README.md",
    ROOT / "sim" / "README.md",
    *PAGES.values(),
)
_BLOCK: Final = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_SAVED: Final = re.compile(
    r"[Ss]ave this as `([\w.]+)`[^\n]*\n\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True, slots=True)
class Block:
    """One fenced block: its language and its text."""

    language: str
    text: str


def blocks(document: Path) -> list[Block]:
    """The fenced blocks that name a language, in order."""
    return [Block(*found) for found in _BLOCK.findall(document.read_text())]


def saved_files(document: Path) -> dict[str, str]:
    """Name and content of each file that the document tells its reader to save."""
    return dict(_SAVED.findall(document.read_text()))


def commands(document: Path) -> list[str]:
    """The lines of the shell blocks, with continued lines joined."""
    shell = [block.text for block in blocks(document) if block.language == "sh"]
    return [line for text in shell for line in text.replace("\\\n", " ").splitlines() if line]


def prose(document: Path) -> str:
    """The document without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", document.read_text(), flags=re.MULTILINE | re.DOTALL)
