"""The pages stay short and plain: so many words in all, so many in a sentence, and nothing of the
code's inside on a page for whoever flies."""

from __future__ import annotations

import re
import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.unit.docs.pages import DOCS, PAGES, ROOT, prose
from tests.unit.docs.test_site import identify

MADE: Final = ("reference", "commands", "python-calls", "studies")
"""By commands, from the code."""
WRITTEN: Final = (ROOT / "README.md", *(PAGES[name] for name in PAGES if name not in MADE))
WORDS: Final = 32_000
"""As `wc -w` counts them: signs of tables, code and links, too."""
MEAN: Final = 16
"""Words of a sentence: pages that are read by people who speak other languages."""
LONGEST: Final = 60
INSIDE: Final = re.compile(r"(?:swarm_ctl|swarm_sim|tests)/\w|\b\w+\.py\b|python -m tests\.")
"""A module's path."""
FOR_CONTRIBUTORS: Final = "understand"
FOR_PROGRAMMERS: Final = ("extensions",)
"""They import what they extend."""
FILES_OF_THE_READER: Final = re.compile(
    r"\b(?:test_patrol|mean|mavproxy|MAVExplorer|\w*own_\w+)\.py\b"
)


def sentences(document: Path) -> Iterator[int]:
    """Words of each sentence in paragraphs and lists; headings, tables and code do not count."""
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*|]|\d+\.) |#)", prose(document)):
        text = re.sub(r"^(?:[-*]|\d+\.)\s+", "", " ".join(part.split()))
        if not text.startswith(("#", "|", "!", "<!--", "---")):
            plain = re.sub(r"\]\([^)]*\)", "]", text)
            for sentence in re.split(r"(?<=[.!?])[\"*)_]*\s+(?=[A-Z`*\[\"(])", plain):
                words = sum(bool(re.search(r"\w", word)) for word in sentence.split())
                if words > 1:
                    yield words


def test_the_pages_are_short() -> None:
    counted = {identify(path): len(path.read_text().split()) for path in WRITTEN}
    most = sorted(counted.items(), key=lambda row: -row[1])[:6]
    assert sum(counted.values()) <= WORDS, f"{sum(counted.values())}; the longest: {most}"


def test_the_sentences_are_short() -> None:
    of_pages = {identify(path): list(sentences(path)) for path in WRITTEN}
    assert statistics.mean(words for page in of_pages.values() for words in page) <= MEAN
    assert {name: max(page) for name, page in of_pages.items() if max(page) > LONGEST} == {}


@pytest.mark.parametrize("document", WRITTEN[1:], ids=identify)
def test_a_page_for_whoever_flies_names_no_module(document: Path) -> None:
    if document.stem in FOR_PROGRAMMERS:
        return
    if document.relative_to(DOCS).parts[0] != FOR_CONTRIBUTORS:
        text = FILES_OF_THE_READER.sub("", document.read_text())
        assert INSIDE.findall(text) == []


WORDS_OF_PILOTS: Final = (
    "geofence",
    "no-fly zone",
    "altitude",
    "return to launch",
    "RTL",
    "failsafe",
    "telemetry",
    "waypoint",
    "SITL",
    "QGroundControl",
    "search pattern",
)


@pytest.mark.parametrize("word", WORDS_OF_PILOTS)
def test_a_word_of_pilots_is_found(word: str) -> None:
    """In a page for whoever flies, beside the glossary, which says what it is called here."""
    found = [
        name
        for name, path in PAGES.items()
        if path.relative_to(DOCS).parts[0] in ("learn", "do")
        and word.lower() in path.read_text().lower()
    ]
    assert found
