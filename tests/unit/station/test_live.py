"""The live view: what it shows, and that it fits wherever it is drawn."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from swarm_ctl.core.model.messages import AgentStatus, Event, Phase
from swarm_ctl.station.output.columns import COLUMNS, Column, fit
from swarm_ctl.station.output.live import render
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.station.pictures import PICTURES, SIZES, drawn, snapshot_path
from tests.unit.station.swarm import flying_model, hexagon_plan, state_of, status_of

PLAN = hexagon_plan()


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("name", PICTURES)
def test_picture(name: str, size: tuple[int, int]) -> None:
    """The screen as it was looked at and found good; `python -m tests.unit.station.pictures` draws
    it anew."""
    assert drawn(PICTURES[name](), *size) == snapshot_path(name, size).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize("width", [20, 40, 79, 80, 99, 109, 110, 200])
@pytest.mark.parametrize("height", [1, 3, 8, 24, 25, 60])
def test_it_fills_exactly_the_room_it_has(name: str, width: int, height: int) -> None:
    lines = drawn(PICTURES[name](), width, height).split("\n")
    assert len(lines) == height
    assert {len(line) for line in lines} == {width}


@pytest.mark.parametrize("count", [1, 6, 14, 15, 32, 100])
def test_many_agents_still_fit_and_the_hidden_ones_are_counted(count: int) -> None:
    view = flying_model(hexagon_plan(count)).view(30.0)
    lines = drawn(view, 80, 24).split("\n")
    shown = sum(" fly " in line for line in lines)
    hidden = sum(int(line.split()[1]) for line in lines if "more agents" in line)
    assert shown + hidden == count
    assert len(lines) == 24
    assert lines[-1].strip() == "Ctrl-C lands the swarm"


def test_agents_in_trouble_are_shown_first() -> None:
    plan = hexagon_plan(100)
    model = flying_model(plan)
    model.fold(status_of(plan, 97, 30.0, outcome="failed", reason="no position"), 30.0)
    text = drawn(model.view(30.0), 80, 24)
    assert "✗ agent 97 failed: no position" in text
    assert "✗97 fly" in text


def test_the_widths_of_80_columns_are_all_used() -> None:
    narrow = [column for column in COLUMNS if column.from_width <= 80 < column.below_width]
    assert sum(column.width for column in narrow) + len(narrow) - 1 == 80


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(2, 8), st.integers(0, 3))
def test_a_number_never_leaves_its_column(value: float, width: int, decimals: int) -> None:
    text = fit(value, width, decimals)
    assert len(text) <= width
    if abs(value) < 10 ** (width - 2):
        assert float(text) == pytest.approx(value, abs=0.5)


@given(st.text(max_size=30))
def test_a_cell_is_as_wide_as_its_column_whatever_it_holds(text: str) -> None:
    printable = "".join(c for c in text if c.isprintable())
    assert cell_len(Column("x", 8, lambda _row, _width: "").place(printable)) == 8


HOSTILE = "\x1b[2J\x1b]0;owned\x07[bold red]x[/]\r\n\u202e\u009b31m 漢字 " * 3


def _hostile() -> SwarmView:
    """An agent that tries to command the terminal."""
    model = flying_model(PLAN)
    model.fold(status_of(PLAN, 3, 30.0, mode=HOSTILE, reason=HOSTILE, outcome="failed"), 30.0)
    model.fold(status_of(PLAN, 4, 30.0, phase=Phase.ARM, reason=HOSTILE), 30.0)
    model.fold(Event(3, 30.0, "info", HOSTILE), 30.0)
    return model.view(30.0)


def test_nothing_an_agent_says_commands_the_terminal() -> None:
    text = drawn(_hostile(), 80, 24)
    assert all(c.isprintable() for line in text.split("\n") for c in line)
    assert len(text.split("\n")) == 24
    assert "[bold red]x[/]" in text


def _printed(view: SwarmView, encoding: str, *, no_color: bool = False) -> bytes:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding=encoding, errors="strict", write_through=True)
    console = Console(
        file=file,
        width=80,
        height=24,
        force_terminal=True,
        no_color=no_color,
        color_system="standard",
    )
    console.print(render(view))
    return raw.getvalue()


@pytest.mark.parametrize("name", [*PICTURES, "hostile"])
def test_an_ascii_terminal_shows_it_too(name: str) -> None:
    view = _hostile() if name == "hostile" else PICTURES[name]()
    assert _printed(view, "ascii").isascii()


def test_without_colour_nothing_is_lost() -> None:
    """NO_COLOR: no colour codes at all, the same words and signs."""
    coloured, plain = (
        _printed(PICTURES["lost"](), "utf-8"),
        _printed(PICTURES["lost"](), "utf-8", no_color=True),
    )
    assert b"\x1b[1;37;41m \xe2\x9c\x97 agent 3 has not been heard" in coloured
    assert re.search(rb"\x1b\[1;31m *SILENT", coloured)
    assert b"\x1b[33m ! agent 1 holds" in coloured
    codes = {
        number for found in re.findall(rb"\x1b\[([0-9;]*)m", plain) for number in found.split(b";")
    }
    assert codes <= {b"0", b"1", b"2"}
    words = re.sub(rb"\x1b\[[0-9;]*m", b"", plain).decode()
    assert words.rstrip("\n") == drawn(PICTURES["lost"](), 80, 24)


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([1e-9, 0.0, -3.0, 99.949, 12345.6, -98765.4, 1e9]),
    st.sampled_from(list(Phase)),
    st.booleans(),
    st.none() | st.floats(0, 1e6),
)
def test_extreme_figures_do_not_break_the_picture(
    place: float, phase: Phase, done: bool, battery: float | None
) -> None:
    model = Model(PLAN)
    model.fold(
        state_of(PLAN, 1, 1e5, position_ned_m=(place, -place, place), phase=phase, done=done), 1e5
    )
    status: AgentStatus = status_of(PLAN, 1, 1e5 - 1, battery_percent=battery, phase=phase)
    model.fold(status, 1e5)
    for width in (80, 140):
        assert {len(line) for line in drawn(model.view(1e5), width, 24).split("\n")} == {width}


def test_snapshots_have_no_strays() -> None:
    wanted = {snapshot_path(name, size) for name in PICTURES for size in SIZES}
    assert set(Path(__file__).with_name("snapshots").glob("*.txt")) == wanted
