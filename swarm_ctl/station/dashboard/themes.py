"""Light, dark, and the terminal's own colours; and where the dashboard's parts stand."""

from __future__ import annotations

import os
from typing import Final

from rich.terminal_theme import TerminalTheme

DARK, LIGHT, PLAIN = "textual-dark", "textual-light", "ansi-dark"
"""Themes; the last one has the terminal's own colours, for `NO_COLOR`."""

# Black, red, green, yellow, blue, magenta, cyan, white. On light: usual yellow, green and cyan can
# hardly be read on white. On dark: Textual's own magenta is its red, and its yellow an orange.
_DULL = """000000 a01e1e 1e6914 825500 1e46a0 78288c 005f87 f7f7f7"""
_BRIGHT = """5a5a5a c83232 78c83c fabe3c 0064b4 be28be 46bedc ffffff"""
_DARK = """1a1a1a e0354b 8fd14f ffd94a 6ea8ff e07be8 4fc8dc d9d9d9"""
_DARK_BRIGHT = """6b6b6b ff6b7d 8fd14f ffd94a 9cc4ff e07be8 4fc8dc f6f6f6"""


def _colours(text: str) -> list[tuple[int, int, int]]:
    return [(int(word[:2], 16), int(word[2:4], 16), int(word[4:], 16)) for word in text.split()]


LIGHT_INKS = TerminalTheme((247, 247, 247), (0, 0, 0), _colours(_DULL), _colours(_BRIGHT))
"""The sixteen colours on a light ground."""
DARK_INKS = TerminalTheme((12, 12, 12), (217, 217, 217), _colours(_DARK), _colours(_DARK_BRIGHT))
"""And on a dark one."""


def by_background() -> str:
    """Light where the terminal says so: `COLORFGBG` is `foreground;background`, of which 7 and 15
    are white."""
    return LIGHT if os.environ.get("COLORFGBG", "").rpartition(";")[2] in ("7", "15") else DARK


CSS: Final = """
Painted { height: 1; overflow: hidden; }
Painted, CellTable, RichLog { scrollbar-size-vertical: 1; background: $background; }
VerticalScroll { scrollbar-size-vertical: 1; }
TabbedContent, TabPane, ContentSwitcher { height: 1fr; padding: 0; }
Tabs, ContentTabs { height: 1; }
Tab.-active { text-style: bold reverse; }
#matrix, #law, #tally, #empty, #answers { height: auto; }
CellTable { height: auto; overflow-x: hidden; }
#swarm { layout: vertical; }
#left { height: auto; max-height: 65%; }
#groups { height: auto; max-height: 30%; display: none; }
#agents { height: auto; max-height: 75%; }
#map { height: 1fr; }
#recent { height: 3; }
#trends { display: none; }
#swarm.low #recent { display: none; }
#swarm.wide { layout: horizontal; }
#swarm.wide #left { height: 1fr; max-height: 100%; }
#swarm.wide #agents { max-height: 85%; }
#swarm.wide #recent { height: 1fr; }
#swarm.wide #map { width: 1fr; }
#entries { height: 1fr; scrollbar-gutter: stable; }
#keys, #entry { height: 1; }
#marked { width: auto; text-style: bold; color: ansi_magenta; }
Footer { dock: none; width: 1fr; background: $background; }
FooterKey, FooterKey .footer-key--key { background: $background; }
FooterKey .footer-key--description { background: $background; }
#entry, #question, #protection { display: none; }
#question { height: auto; }
#prompt { width: 2; padding-left: 1; text-style: bold; }
#line { width: 1fr; height: 1; border: none; padding: 0; background: $background; }
"""
