"""The claims of the safety and security pages: what each says, and the command that shows it.

`claims.yaml` has a row a command. What a row `says` are words of a page with its figures in braces:
`{collided@safety:off=278} of 800 missions` is the text "278 of 800 missions", and its 278 is what
`collided` reads in the rows with `safety` `off`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

import yaml
from pydantic import BaseModel, ConfigDict

CLAIMS: Final = Path(__file__).with_name("claims.yaml")
PAGES: Final = {
    "README": "README.md",
    "safety": "docs/do/safety.md",
    "security": "docs/do/security.md",
    "safety-evidence": "docs/understand/safety-evidence.md",
    "security-evidence": "docs/understand/security-evidence.md",
    "figures": "docs/understand/figures.md",
}
"""Of the README its section on safety alone."""
_README: Final = "Is it safe?"
_MARKER: Final = re.compile(r"\{([\w%/<]+)(?:@([^=}]+))?=([^}]+)\}")
_CLAIM: Final = re.compile(r"\d|\b(?:none|never|always|no pair)\b", re.IGNORECASE)
_NO_CLAIM: Final = re.compile(r"\]\([^)]*\)|[|\s:-]+")


class Method(StrEnum):
    """How a claim is shown."""

    PROOF = "proof"
    STUDY = "study"
    FUZZ = "fuzz"
    AUTOPILOT = "flight on an autopilot"
    TEST = "test"
    MEASURED = "measured"


class FlownWith(StrEnum):
    """With which option a row is flown."""

    QUICK = "quick"
    ALL = "all"
    BY_HAND = "by hand"
    """Its figures are the machine's, or it takes days."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a page."""

    said: str
    """As the page writes it."""
    reading: str
    """What is read of the command's result: a column, or a word of `readings`."""
    where: tuple[tuple[str, str], ...]
    """Columns and their values, of the rows that count."""
    of: str
    """The page's words that it stands in."""


class _Fields(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ClaimRow(_Fields):
    """One command, and what pages say of it."""

    name: str
    claim: str
    method: Method
    command: str
    flown: FlownWith = FlownWith.ALL
    says: tuple[str, ...] = ()
    sets: Mapping[str, str] = {}
    """Names for what stands behind `@` more than once."""
    sections: Mapping[str, int] = {}
    """Of a page's whole section, `page#Heading`: how many sentences and lines with figures it has.
    A sentence more or less is a claim that nobody has looked at."""
    prints: tuple[str, ...] = ()
    """Words of the command's own output, with their figures; spaces count as one."""
    invariants: tuple[str, ...] = ()
    """Of a campaign: what none of its flights may break; what else broke is told."""
    limits: str

    @property
    def kind(self) -> str:
        """`study`, `fuzz`; of others the program."""
        first, second, *_ = self.command.split()
        return second if first == "swarm-ctl" else first

    @property
    def words(self) -> list[str]:
        """What it says, as the pages have it."""
        return [_MARKER.sub(r"\3", said) for said in self.says]

    @property
    def figures(self) -> list[Figure]:
        """What is read again."""
        return [
            Figure(said=mark[3], reading=mark[1], where=tuple(self._where(mark[2] or "")), of=words)
            for said, words in zip(self.says, self.words, strict=True)
            for mark in _MARKER.finditer(said)
        ]

    def _where(self, words: str) -> Iterator[tuple[str, str]]:
        for word in filter(None, words.split(",")):
            name, colon, value = word.partition(":")
            yield from [(name, value)] if colon else self._where(self.sets[name])


class SoraRow(_Fields):
    """What an assessor by SORA 2.5 asks for."""

    name: str
    asks: str
    covered: str
    """`partly`, or `not covered`."""
    rows: tuple[str, ...] = ()
    why: str


class Claims(_Fields):
    """All of them."""

    rows: tuple[ClaimRow, ...]
    sora: tuple[SoraRow, ...]


def read_claims(path: Path = CLAIMS) -> Claims:
    """Those of a file. pydantic's ValidationError names what is wrong in it."""
    return Claims.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))


def claims_of(page: str, text: str) -> dict[str, list[str]]:
    """The sentences and table lines with figures by section `page#Heading`."""
    found = dict[str, list[str]]()
    plain = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    for part in re.split(r"^(?=#)", plain, flags=re.MULTILINE):
        heading, _, body = part.partition("\n")
        name = heading.lstrip("# ")
        if page != "README" or name == _README:
            found[f"{page}#{name}"] = list(_sentences(body))
    return found


def _sentences(body: str) -> Iterator[str]:
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*|]|\d+\.) )", re.sub(r"!\[.*?\]", "", body)):
        line = re.sub(r"^\d+\. ", "", " ".join(part.split()))
        for each in [line] if line.startswith("|") else re.split(r"(?<=[.!?])\s+", line):
            if _CLAIM.search(_NO_CLAIM.sub(" ", each)):
                yield each


def unclaimed(claims: Claims, pages: Mapping[str, str]) -> list[str]:
    """What the pages' texts say without a row, and what a row says that no page does."""
    wrong = list[str]()
    sections = {name: n for row in claims.rows for name, n in row.sections.items()}
    words = [" ".join(said.split()) for row in claims.rows for said in row.words]
    whole = " ".join(" ".join(text.split()) for text in pages.values())
    there = {k: v for page, text in pages.items() for k, v in claims_of(page, text).items()}
    for name, sentences in there.items():
        if name in sections:
            if len(sentences) != sections[name]:
                wrong.append(
                    f"{name}: {len(sentences)} sentences with figures, its row has {sections[name]}"
                )
            continue
        wrong += [
            f"{name}: no row: {each}"
            for each in sentences
            if not any(said in each or each in said for said in words)
        ]
    wrong += [f"{name}: no such section" for name in sections if name not in there]
    return wrong + [f"no page says: {said}" for said in words if said not in whole]
