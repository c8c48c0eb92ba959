"""Words for a terminal: foreign text made harmless, many agents named in few characters."""

from __future__ import annotations

from collections.abc import Iterable

from swarm_ctl.errors import InputError


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


def ids_of(text: str, option: str) -> tuple[int, ...]:
    """1, 2, 3, 5 of `1-3,5`, in order; none of ''. InputError names the option that it stood in."""
    chosen: set[int] = set()
    for word in filter(None, map(str.strip, text.split(","))):
        first, _, last = word.partition("-")
        try:
            span = range(int(first), int(last or first) + 1)
        except ValueError:
            span = range(0)
        if not span or span[-1] > 65535:
            raise InputError(f"{option} {text!r}; allowed: ids and ranges, such as 2,5-7")
        chosen.update(span)
    return tuple(sorted(chosen))


def agents_named(ids: Iterable[int]) -> str:
    """`agent 3`, or `agents 1-6`; of none, `this station`, which says it of itself."""
    distinct = set(ids)
    if not distinct:
        return "this station"
    return f"agent{'s' if len(distinct) > 1 else ''} {ranges(distinct)}"


def agents_counted(ids: Iterable[int], room: int = 40) -> str:
    """As `agents_named`, or `14 agents` where their ids take more than `room` characters."""
    distinct = set(ids)
    words = agents_named(distinct)
    return words if len(words) <= room else f"{len(distinct)} agents"
