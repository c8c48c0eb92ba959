"""The dashboard's keys: one table for the application, its footer and the player."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from textual.binding import Binding, BindingType

from swarm_ctl.commands.parse import KINDS

SCREENS: Final = ("swarm", "links", "sigma", "log", "help")
ALWAYS: Final = ("ctrl+c", "ctrl+q")
"""Keys that mean the same whatever is open."""
ONLY_ON: Final = {
    "mark_cursor": "swarm",
    "mark_all": "swarm",
    "place_zone": "swarm",
    "sort_next": "swarm",
    "sort_turn": "swarm",
    "turn_map": "swarm",
    "metric_next": "links",
    "level_next": "log",
    "filter": "log",
}
"""Keys that mean something on one screen alone."""
MOVES: Final = {
    **{str(k + 1): f"go('{name}')" for k, name in enumerate(SCREENS[:4])},
    "question_mark,f1": "go('help')",
    "tab": "go_on(1)",
    "shift+tab": "go_on(-1)",
    "up,k": "cursor(-1)",
    "down,j": "cursor(1)",
    "pageup": "scroll(-1)",
    "pagedown": "scroll(1)",
    "escape": "unmark",
}
"""Keys that move about."""


def at_once(bindings: Sequence[Binding]) -> list[BindingType]:
    """Keys whose actions are done before the next key is looked at: typed fast, what stands behind
    a key that opens the command line is no order."""
    return [replace(binding, priority=True) for binding in bindings]


def hidden(keys: dict[str, str]) -> list[Binding]:
    """Keys that the footer doesn't show, and their actions."""
    return [Binding(key, action, show=False) for key, action in keys.items()]


def bindings() -> list[BindingType]:
    """Of the application."""
    shown = {"land": "land", "hold": "hold", "resume": "resume", "next": "next"}
    orders = [
        Binding(
            kind.key,
            f"command('{kind.name} ')" if kind.usage else f"order('{kind.name}')",
            shown.get(kind.name, ""),
            show=kind.name in shown,
        )
        for kind in sorted(KINDS, key=lambda kind: kind.name != "land")
    ]
    shown_keys = [
        Binding("ctrl+c", "interrupt", "land all", key_display="^C"),
        *orders,
        Binding("colon", "command('')", "command"),
        Binding("space", "mark_cursor", "mark"),
        Binding("s", "sort_next", "sort"),
        Binding("v", "metric_next", "view"),
        Binding("v", "turn_map", show=False),
        Binding("slash", "filter", "filter"),
        Binding("slash", "look_for", show=False),
        Binding("w", "level_next", "worst"),
        Binding("x", "acknowledge", "seen"),
        Binding("ctrl+q", "leave", show=False),
    ]
    keys = {"q": "leave", "a": "mark_all", "S": "sort_turn", "Z": "place_zone", "t": "theme"}
    return at_once([*shown_keys, *hidden(keys | MOVES)])
