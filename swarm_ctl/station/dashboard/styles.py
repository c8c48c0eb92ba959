"""Where the dashboard's parts stand, as Textual CSS."""

from __future__ import annotations

from typing import Final

CSS: Final = """
Painted { height: 1; overflow: hidden; }
Painted, CellTable, RichLog { scrollbar-size-vertical: 1; background: $background; }
VerticalScroll { scrollbar-size-vertical: 1; }
TabbedContent, TabPane, ContentSwitcher { height: 1fr; padding: 0; }
Tabs, ContentTabs { height: 1; }
Tab.-active { text-style: bold reverse; }
#matrix, #law, #tally, #empty { height: auto; }
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
