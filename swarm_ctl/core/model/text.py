"""Words for a terminal: text of others made harmless, many agents named in few characters."""

from __future__ import annotations

from collections.abc import Iterable


def printable(text: str, limit: int = 200) -> str:
    """`text` on one line without control characters (they could command a terminal), at most
    `limit` characters."""
    clean = "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)
    return clean if len(clean) <= limit else clean[: limit - 3] + "..."


def escaped(text: str) -> str:
    """`text` with control and invisible characters as escapes such as `\\x1b`."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def ranges(numbers: Iterable[int]) -> str:
    """`1-3, 5` of 1, 2, 3, 5."""
    spans: list[list[int]] = []
    for number in sorted(set(numbers)):
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in spans)


def agents_named(ids: Iterable[int]) -> str:
    """`agent 3`, or `agents 1-6`."""
    distinct = set(ids)
    return f"agent{'s' if len(distinct) > 1 else ''} {ranges(distinct)}"
