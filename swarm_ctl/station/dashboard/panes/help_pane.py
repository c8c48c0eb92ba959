"""The help screen: keys, commands, what the colours and signs mean."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.widgets import Static

from swarm_ctl.commands.parse import KINDS
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.panes.pane import Pane
from swarm_ctl.station.picture.link_quality import (
    AGE_ERROR_S,
    AGE_WARNING_S,
    LOSS_ERROR,
    LOSS_WARNING,
)

KEYS: Final = """
1 2 3 4 ? | screens: swarm, links, sigma, log, help; also tab, or a click
↑ ↓ space a | move the cursor, mark its agent, mark all or none: commands go to the marked ones
Z | place a zone on the map: arrows (shift: further) or a click move it, + - size it, Enter
  opens its order, Esc drops it
s S | sort by the next column, reverse the order; or click a title
v | swarm: the map of the swarm, of all of the mission, from south, from east; links: what the
  matrix shows
/ w | log: filter by words, by level
x | acknowledge alarms: they stay, and no longer count as new
: | command line; tab completes, ↑ brings the last one back, esc leaves it
t | light or dark
q | leave (a station that only watches; the last one of a swarm asks first)
Ctrl-C | land the swarm; again: stop everything at once. A watching station only leaves
mouse | a screen's name, a title of the table, an agent in the table or map, a key below
"""
SIGNS: Final = f"""
colours | green: well, cyan: under way or waiting, yellow: look, red: at stake, magenta: marked by
  you. Each agent has a colour of its own, the same in table, map and report; an alarm is a ground
map | number: agent, ○ its slot, ⌂ where it took off, dots: its trail, circle: half of r_out (where
  two touch, avoidance begins: cyan); × the path's ends; outlines: fence and zones; ◎ target. In the
  corner: how old the news of it is, how far the formation's centre is off its place, its height
groups | a line for each that flies now: its step of how many, agents, how far it is off its
  shape, … how long it waits and for whom. Its agents have its colour; its name stands below them,
  and in the table in the place of the mode
from a side | heights above the origin at the left, on a scale of their own
lines | neighbours; green well, yellow bad or nearly too long, red lost
table | up: height; error: distance from its place in the shape; nearest: how near which agent is;
  heard: how long ago; late: of its ticks, the p99. Dimmed: it ended, or follows another agent
  that failed
curves | the nearest pair in the air, with r_in, and the formation's error, over the last minutes
links | a row listens, a column speaks; trip: there and back. Yellow: a state older than
  {1000 * AGE_WARNING_S:.0f} ms or {LOSS_WARNING:.0%} lost in 10 s; red:
  {1000 * AGE_ERROR_S:.0f} ms or {LOSS_ERROR:.0%}.
sigma | one row for each side of a pair; D must lie between its bounds; over 100 % of the budget
  Property 1 does not hold for that agent; paper, narrow, inactive, overspeed: the rule that D was
  chosen by (overspeed: by none); safety filter: how often the agent flew something else than the
  law's wish
"""


def commands() -> str:
    """Every command by its key, and what it does."""
    asks = {True: " (asks first)", False: ""}
    lines = [
        f"{kind.key or ' '}  {kind.name} {kind.usage} | {kind.does}{asks[bool(kind.asks[0])]}"
        for kind in KINDS
    ]
    words = "for some agents only: mark them, or 'land @1,3-5'; 'tune plan': the mission's own law"
    groups = "for a group by its name: 'hold @scouts', 'form vee @scouts', 'land @scouts,7'"
    return "\n".join([*lines, f"@ | {words}", f"@ | {groups}"])


def _explained(text: str) -> Iterable[list[str]]:
    """[words, what they mean] of each entry; a long one goes on in indented lines."""
    return (entry.split(" | ") for entry in re.split(r"\n(?! )", text.strip("\n")))


class HelpPane(Pane):
    """Sections of words and what they mean."""

    def __init__(self, sections: dict[str, str]) -> None:
        super().__init__("? Help", id="help")
        self._sections = sections

    def compose(self) -> ComposeResult:
        with VerticalScroll(can_focus=False):
            for title, text in self._sections.items():
                table = Table.grid(padding=(0, 2))
                table.add_column(width=29 if title.startswith("commands") else 14, no_wrap=True)
                table.add_column()
                for words, meaning in _explained(text):
                    table.add_row(Text(f"   {words}", "bold"), Text(" ".join(meaning.split())))
                more = "" if title in list(self._sections)[1:] else "   ↓ ↑ PgDn PgUp: more of this"
                yield Static(Text.assemble((f" {title}", "bold underline"), (more, "dim")))
                yield Static(table)

    def draw(self, picture: Picture) -> None:
        """Nothing changes here."""
