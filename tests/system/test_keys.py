"""Every key and every command of the dashboard by keystrokes in a real terminal: typed slowly and
all at once, at 80x24 and wide."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Final

import pytest

from swarm_ctl.commands.parse import KINDS
from tests.system.running import ROOT
from tests.system.terminal import Terminal, needs_tmux

pytestmark = [pytest.mark.timeout(300), needs_tmux]

SMALL, WIDE = (80, 24), (160, 50)
EACH = pytest.mark.parametrize(
    ("size", "slowly"),
    [
        pytest.param(SMALL, False, id="80x24-at-once"),
        pytest.param(SMALL, True, id="80x24-slowly", marks=pytest.mark.long),
        pytest.param(WIDE, False, id="160x50-at-once", marks=pytest.mark.long),
        pytest.param(WIDE, True, id="160x50-slowly", marks=pytest.mark.long),
    ],
)
_KEY_S: Final = 0.12
"""Between two keys that are typed slowly."""

AT_ONCE: Final = {
    ("h",): "hold",
    ("r",): "resume",
    ("n",): "next",
    ("f", "h", "Tab", "Enter"): "form hexagon",
    ("f", "Tab", "Enter"): "form hexagon",
    ("f", *"hexagon", "Enter"): "form hexagon",
    ("f", "l", "Tab", "Enter"): "form l",
    ("m", *"20", "Space", *"10", "Enter"): "move 20 10",
    ("m", "Space", *"-5", "Space", *"7.5", "Space", "2", "Enter"): "move -5 7.5 2",
    ("F", "b", "Tab", "Space", *"-20", "Space", "0", "Enter"): "follow boat -20 0",
    ("g", *"20", "Space", *"-5", "Space", *"@3", "Enter"): "goto 20 -5 @3",
    ("z", *"lift", "Space", *"pond", "Enter"): "zone lift pond",
    ("u", *"h=0.04", "Enter"): "tune h=0.04",
    ("u", "h", "Tab", "BSpace", "4", "Enter"): "tune h=0.04",
    ("u", *"plan", "Enter"): "tune plan",
    (":", *"hold", "Enter"): "hold",
    (":", "h", "Tab", "Enter"): "hold",
    (":", *"resume", "Enter"): "resume",
    (":", *"next", "Enter"): "next",
    (":", *"form", "Space", "Tab", "Enter"): "form hexagon",
    (":", *"fo", "Tab", "Tab", "Enter"): "form hexagon",
    (":", *"move", "Space", "2", "Space", *"-3", "Enter"): "move 2 -3",
    (":", *"tune", "Space", *"h=0.03", "Enter"): "tune h=0.03",
    (":", *"follow", "Space", *"boat", "Enter"): "follow boat",
    (":", *"readmit", "Space", *"@4", "Enter"): "readmit @4",
    (":", *"hold", "Space", *"@2,4-5", "Enter"): "hold @2,4,5",
    (":", "Up", "Enter"): "hold @2,4,5",
}
"""Keys and the order that they give, in this order of time."""
AFTER_A_QUESTION: Final = {
    ("l",): "land",
    ("b",): "return",
    ("K",): "kill",
    (":", *"land", "Enter"): "land",
    (":", *"return", "Enter"): "return",
    (":", *"kill", "Enter"): "kill",
    (":", *"kill", "Space", *"@3-4", "Enter"): "kill @3,4",
    (":", *"land", "Space", "@", "1", "Enter"): "land @1",
    (":", *"expel", "Space", *"@5", "Enter"): "expel @5",
    (":", *"launch", "Space", *"@6", "Enter"): "launch @6",
}
"""Keys and the order that one more Enter gives."""
NOTHING: Final = {
    (":", "l", "Tab", "Enter"): "no command 'l'",
    (":", *"ret", "Tab", "Enter"): "no command 'ret'",
    (":", *"ki", "Tab", "Enter"): "no command 'ki'",
    (":", *"hover", "Enter"): "no command 'hover'",
    ("m", *"20", "Enter"): "usage: move NORTH EAST",
    ("u", *"h=7", "Enter"): "tune: h 7",
}
SCREENS: Final = {
    "2": "rx\\tx",
    "3": "tally of the flight",
    "4": "step 2: form hexagon",
    "?": "commands, by key",
    "1": "▴id",
    "Tab": "rx\\tx",
    "BTab": "▴id",
    "S": "▾id",
    "s": "phase▴",
    "a": "6 marked:",
    "Escape": "^C leave",
    "Down": "",
    "Space": "1 marked:",
    "x": "no new alarms",
    "/": "words to look for",
}
"""Keys and what they bring to the screen, in this order of time."""


class Desk:
    """The dashboard over a still picture, and the file of its orders."""

    def __init__(self, folder: Path, size: tuple[int, int], slowly: bool, step: int = 2) -> None:
        self._orders = folder / "orders"
        self._slowly = slowly
        program = ("env", f"PYTHONPATH={ROOT}", sys.executable, "-m", "tests.system.still")
        self.terminal = Terminal(self._orders, str(step), cwd=folder, size=size, program=program)

    def press(self, *keys: str) -> None:
        """One key after the other, or all of them in one write."""
        for some in [(key,) for key in keys] if self._slowly else [keys]:
            self.terminal.press(*some)
            time.sleep(_KEY_S if self._slowly else 0.0)

    @property
    def orders(self) -> list[str]:
        """What was ordered so far: the order and its agents, if not all."""
        lines = self._orders.read_text().splitlines() if self._orders.exists() else []
        return [line.removesuffix(" @all") for line in lines]

    def wait_for_orders(self, count: int) -> list[str]:
        """The orders, once there are so many."""
        self.terminal.wait_for(lambda _: len(self.orders) >= count, 20.0)
        return self.orders


def test_each_kind_of_order_has_its_keys_below() -> None:
    """Seen each day: the rows themselves are typed once a week."""
    orders = (*AT_ONCE.values(), *AFTER_A_QUESTION.values())
    assert {order.split()[0] for order in orders} == {kind.name for kind in KINDS}


@pytest.mark.long
@EACH
def test_every_order(tmp_path: Path, size: tuple[int, int], slowly: bool) -> None:
    """Each is given once, to the agents that were named; what lands, returns or kills is asked
    about, and any other key than Enter drops it."""
    desk, given = Desk(tmp_path, size, slowly), 0
    with desk.terminal as terminal:
        terminal.wait_for("6/6 agents")
        for keys, order in AT_ONCE.items():
            desk.press(*keys)
            given += 1
            assert desk.wait_for_orders(given)[-1] == order, keys
        for keys, order in AFTER_A_QUESTION.items():
            for answer in ("y" if keys == ("K",) else "Escape", "Enter"):
                desk.press(*keys)
                shown = terminal.wait_for("Enter sends it, Esc drops it.")
                assert f" {order.split()[0]} agent" in shown
                assert len(desk.orders) == given, keys
                terminal.press(answer)
                if answer == "Enter":
                    given += 1
                    assert desk.wait_for_orders(given)[-1] == order, keys
                else:
                    terminal.wait_for(f"{order.split()[0]}: not sent")
                terminal.wait_for(lambda text: "Enter sends it" not in text)
        assert len(desk.orders) == given == len(AT_ONCE) + len(AFTER_A_QUESTION)


@EACH
def test_what_is_no_order_orders_nothing(
    tmp_path: Path, size: tuple[int, int], slowly: bool
) -> None:
    """`f`, `l`, tab, enter once landed a swarm."""
    desk = Desk(tmp_path, size, slowly)
    with desk.terminal as terminal:
        terminal.wait_for("6/6 agents")
        for keys, words in NOTHING.items():
            desk.press(*keys)
            terminal.wait_for(words)
        desk.press(":", *"land")
        terminal.wait_for(":land")
        terminal.press("Escape")
        terminal.wait_for(lambda text: ":land" not in text)
        for key, words in SCREENS.items():
            terminal.press(key)
            terminal.wait_for(words)
            if key == "Escape":
                terminal.wait_for(lambda text: "marked" not in text)
        terminal.press("Escape")
        terminal.wait_for("filter w worst")
        for key in ("j", "k", "PageDown", "PageUp", "v", "w", "t", "t", "F1", "1", "Enter"):
            terminal.press(key)
        terminal.press("q")
        terminal.wait_for("leave? No other station is heard: the agents land after 5 s.")
        terminal.press("n")
        terminal.wait_for("not left")
        terminal.press("q")
        terminal.wait_for("Enter leaves")
        terminal.press("Enter")
        code, _ = terminal.wait_for_end()
        assert (code, desk.orders) == (0, [])
