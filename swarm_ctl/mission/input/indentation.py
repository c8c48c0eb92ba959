"""Finds the line of a YAML text that is indented unlike its siblings. YAML's own message names what
a parser expected, not what a writer did."""

from __future__ import annotations

import re
from typing import NamedTuple

_ENTRY = re.compile(r"(?P<indent> *)(?P<dash>- +|-$)?(?P<rest>.*)")


class _Level(NamedTuple):
    indent: int
    dash: bool
    """Its lines are entries of a list."""


def misindented(text: str, number: int) -> str:
    """What is wrong with the indentation of line `number` (from 1) of a text that is no YAML: in
    words, with what its siblings have; '' where its indentation is sound."""
    levels, opens = list[_Level](), True
    lines = text.splitlines()[:number]
    for line in lines[:-1]:
        if line.strip() and not line.lstrip().startswith("#"):
            levels, opens = _after(levels, line), _opens(line)
    if not lines or not (line := lines[-1]).strip():
        return ""
    found = _level(line)
    deeper = [level for level in levels if level.indent > found.indent]
    same = [level for level in levels if level.indent == found.indent]
    alike = [level for level in levels if level.dash == found.dash]
    if same or not alike or (not deeper and opens):
        return ""
    sibling = min(alike, key=lambda level: (abs(level.indent - found.indent), -level.indent))
    return f"line {number} is indented by {found.indent}, its siblings by {sibling.indent}"


def _level(line: str) -> _Level:
    found = _ENTRY.match(line)
    return _Level(len(found["indent"]), bool(found["dash"])) if found else _Level(0, False)


def _after(levels: list[_Level], line: str) -> list[_Level]:
    """The levels that are open after a line."""
    own = _level(line)
    kept = [level for level in levels if level.indent < own.indent]
    kept.append(own)
    found = _ENTRY.match(line)
    if found and found["dash"] and re.match(r"[\w-]+:( |$)", found["rest"]):
        kept.append(_Level(own.indent + len(found["dash"]), False))
    return kept


def _opens(line: str) -> bool:
    """Whether what follows may be indented further."""
    return line.partition(" #")[0].rstrip().endswith((":", "-", "|", ">"))
