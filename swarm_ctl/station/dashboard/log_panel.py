"""The log: what the journal holds, filtered; the newest at the bottom."""

from __future__ import annotations

from typing import Final

from rich.cells import cell_len

from swarm_ctl.core.model.text import ranges
from swarm_ctl.station.dashboard.columns import LEVEL_STYLE, UNICODE
from swarm_ctl.station.dashboard.picture import Picture
from swarm_ctl.station.dashboard.styled_line import Line, wrapped
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import Entry

_KIND_STYLE: Final = {
    "command": "bold magenta",
    "cleared": "green",
    "station": "cyan",
    "vehicle": "",
}
_WORDS_AT: Final = 31


def log_lines(picture: Picture, width: int) -> list[Line]:
    """All entries that pass the filter, long ones on several lines."""
    entries = [entry for entry in picture.entries if passes(entry, picture)]
    lines = [line for entry in entries for line in _entry_lines(entry, width)]
    return lines or [
        Line(
            "   nothing in the log yet" if not picture.entries else "   nothing passes the filter",
            "dim",
        )
    ]


def passes(entry: Entry, picture: Picture) -> bool:
    """Level and words of the filter; every word must be somewhere in the line."""
    chosen = picture.chosen
    if entry.level < chosen.log_level:
        return False
    line = f"{entry.kind} {_who(entry)} {entry.text}".lower()
    return all(word in line for word in chosen.log_words.lower().split())


def _who(entry: Entry) -> str:
    return ranges(entry.agents) if entry.agents else ""


def _entry_lines(entry: Entry, width: int) -> list[Line]:
    bad = entry.level >= Level.WARNING
    name = LEVEL_STYLE[entry.level] if bad else _KIND_STYLE.get(entry.kind, "")
    sign = UNICODE.of(entry.level) if bad else UNICODE.well if entry.kind == "cleared" else " "
    words = entry.text + (f" (×{entry.count})" if entry.count > 1 else "")
    words += "  [seen]" if entry.acknowledged else ""
    head = Line(f" {entry.time_s:7.1f} ", "dim").add(f"{sign} ", name)
    head.add(entry.kind, name or "dim", size=8).add(
        _who(entry), "bold", size=_WORDS_AT - head.width - 1
    ).add(" ")
    room = max(10, width - _WORDS_AT)
    rows = wrapped(_broken(words, room), room)
    lines = [head.add(rows[0] if rows else "", name)]
    lines += [Line(" " * _WORDS_AT).add(row, name) for row in rows[1:]]
    return lines


def _broken(text: str, room: int) -> list[str]:
    """Words, those that are too long for a line in pieces."""
    found = []
    for word in text.split(" "):
        while cell_len(word) > room - 2:
            found.append(word[: room // 2 - 1])
            word = word[room // 2 - 1 :]
        found.append(word)
    return found
