"""The help screen: keys, commands, what the colours and signs mean."""

from __future__ import annotations

from typing import Final

from swarm_ctl.commands.parse import KINDS
from swarm_ctl.station.dashboard.links_panel import LEGEND
from swarm_ctl.station.dashboard.styled_line import Line, wrapped

_KEYS: Final = (
    ("1 2 3 4 ?", "screens: swarm, links, sigma, log, help; also tab, or a click"),
    (
        "↑ ↓ space a",
        "move the cursor, mark its agent, mark all or none: orders go to the marked ones",
    ),
    ("s S", "sort by the next column, turn the order round; or click a title"),
    ("v", "links: what the matrix shows"),
    ("/ w", "log: filter by words, by level"),
    ("x", "alarms seen: they stay, and no longer count as new"),
    (":", "command line; tab completes, ↑ brings the last one back, esc leaves it"),
    ("t", "light or dark"),
    ("q", "leave (a station that only watches; the last one of a swarm asks first)"),
    ("Ctrl-C", "land the swarm; again: stop everything at once. A watching station only leaves"),
    (
        "mouse",
        "a screen's name, a title of the table, an agent in the table or on the map, a key below",
    ),
)
_SIGNS: Final = (
    (
        "map",
        "number: agent, ○ slot to fill, dots: where it came from, circle: half of r_out (two that touch avoid)",
    ),
    ("lines", "neighbours; green well, yellow bad or nearly too long, red lost"),
    (
        "table",
        (
            "A: ● armed, ○ not; batt: percent; up: height [m]; err: distance from its place in the shape [m];"
            " near: nearest agent, and how near [m]; age: of its last state [s]; Hz, late: of its ticks, late as the"
            " p99 in ms"
        ),
    ),
    ("links", "a row listens, a column speaks; trip: there and back. " + LEGEND),
    (
        "sigma",
        (
            "one line for each side of a pair; D must lie between its bounds; over 100 % of the budget Property 1 does"
            " not hold for that agent; paper, narrow, inactive, overspeed: by which rule D was chosen (overspeed: by"
            " none); safety filter: how often it flew something else than the law's wish"
        ),
    ),
)


def help_lines(width: int) -> list[Line]:
    """The whole screen."""
    orders = [
        (
            f"{kind.key or ' '}  {kind.name} {kind.usage}".rstrip(),
            kind.does + (" (asks once)" if kind.asks else ""),
        )
        for kind in KINDS
    ]
    lines = rows("orders, by key or after ':'", orders, 28, width)
    lines.append(
        Line(
            "   for some agents only: mark them, or 'land @1,3-5'; 'tune plan' is the mission's own law",
            "dim",
        )
    )
    return [*lines, *rows("keys", _KEYS, 14, width), *sign_rows(width)]


def sign_rows(width: int) -> list[Line]:
    """What the signs mean."""
    return rows("signs", _SIGNS, 14, width)


def rows(
    title: str, said: tuple[tuple[str, str], ...] | list[tuple[str, str]], at: int, width: int
) -> list[Line]:
    """Words and what they mean, under a title."""
    lines = [Line(f" {title}", "bold underline")]
    for what, words in said:
        first, *others = wrapped(words.split(), max(20, width - at - 4), 0)
        lines.append(Line(f"   {what}", "bold").to(at + 3).add(first))
        lines += [Line().to(at + 3).add(other) for other in others]
    return lines
