"""The dashboard: what it shows, and that keys and mouse do what they say."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path

import pytest
from textual.events import Key, Paste
from textual.filter import NoColor
from textual.pilot import Pilot

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.messages import Ack, Command, Event, VehicleLinkReport
from swarm_ctl.station.dashboard.app import Dashboard
from swarm_ctl.station.dashboard.drawing.picture import Chosen, Picture
from swarm_ctl.station.dashboard.panes.agent_table import in_order, titles
from swarm_ctl.station.dashboard.panes.swarm_pane import SwarmPane
from swarm_ctl.station.dashboard.themes import DARK, LIGHT, PLAIN
from swarm_ctl.station.picture.protection import MeshKind, Protection
from swarm_ctl.station.picture.view import SwarmView
from tests.on_demand import on_demand
from tests.unit.plans import steps_of
from tests.unit.station.pictures import PICTURES, PLAN
from tests.unit.station.screens import (
    SHOWN,
    SIZES,
    Desk,
    drawn,
    opened,
    settled,
    shown,
    snapshot_path,
    text,
)
from tests.unit.station.swarm import flying_model, hexagon_plan, status_of

Play = Callable[[Dashboard, Pilot[None], Desk], Awaitable[None]]


def _play(
    play: Play,
    view: SwarmView | None = None,
    size: tuple[int, int] = (80, 24),
    *,
    owns_run: bool = True,
) -> None:
    """Open a dashboard and do something with it."""

    async def go() -> None:
        async with opened(view or PICTURES["well"](), size, owns_run=owns_run) as (
            app,
            pilot,
            desk,
        ):
            await play(app, pilot, desk)

    asyncio.run(go())


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
@pytest.mark.parametrize("name", SHOWN)
def test_screens_as_they_were_found_good(name: str, size: tuple[int, int]) -> None:
    """`python -m tests.unit.station.screens` draws them anew."""
    for screen, words in asyncio.run(drawn(name, size)).items():
        assert words == snapshot_path(name, screen, size).read_text(encoding="utf-8"), screen


def test_snapshots_have_no_strays() -> None:
    wanted = {
        snapshot_path(name, screen, size)
        for name, screens in SHOWN.items()
        for screen in screens
        for size in SIZES
    }
    assert set((Path(__file__).with_name("snapshots") / "dashboard").glob("*")) == wanted


@pytest.mark.parametrize("size", [(20, 6), on_demand((40, 12)), (119, 20), (120, 20), (250, 80)])
def test_every_screen_fits_wherever_it_is_drawn(size: tuple[int, int]) -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        for key in ("1", "2", "3", "4", "question_mark"):
            await pilot.press(key)
            await settled(pilot)
            lines = text(app).splitlines()
            assert len(lines) == size[1]
            assert {len(line) for line in lines} == {size[0]}

    _play(play, PICTURES["lost"](), size)


def test_a_click_changes_screens() -> None:
    """Keys do in a real terminal (`tests/system/test_keys.py`)."""

    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        row, column = _find(app, "4 Log")
        await pilot.click(offset=(column, row))
        await settled(pilot)
        assert "EKF variance high" in text(app)

    _play(play)


def _find(app: Dashboard, words: str) -> tuple[int, int]:
    for row, line in enumerate(text(app).splitlines()):
        if words in line:
            return row, line.index(words)
    raise AssertionError(f"{words!r} is not on the screen:\n{text(app)}")


def test_a_click_on_a_title_sorts_and_the_next_one_turns_the_order_round() -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        for backwards in (False, True):
            row, column = _find(app, "nearest m")
            await pilot.click(offset=(column + 2, row))
            await settled(pilot)
            assert (app._chosen.sort, app._chosen.backwards) == ("nearest m", backwards)
            assert ("▾nearest m" if backwards else "▴nearest m") in text(app)
        rows = [line for line in text(app).splitlines() if " fly " in line]
        assert [line.split()[0] for line in rows] == [
            str(agent.id) for agent in in_order(app.picture or Picture(PICTURES["well"]()))
        ]

    _play(play)


def test_orders_by_key_go_to_all_or_to_the_marked() -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press("h")
        await pilot.press("down", "down", "space", "h")
        row, column = _find(app, "  5 fly")
        await pilot.click(offset=(column + 3, row))
        await pilot.press("r", "escape", "n")
        wanted = [
            Order("hold"),
            Order("hold", (), (2,)),
            Order("resume", (), (2, 5)),
            Order("next", at_step=2),
        ]
        assert desk.orders == wanted

    _play(play)


def test_a_zone_is_placed_on_the_map_by_keys_and_clicks() -> None:
    """Enter opens its order, which another Enter sends; Esc drops it. A key that it does not take
    is the screen's: `h` holds. A map that is seen from a side is seen from above meanwhile."""

    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press("Z")
        first = app._chosen.new_zone
        assert first is not None
        pane, picture = app.pane, app.picture
        assert isinstance(pane, SwarmPane)
        assert picture is not None
        stride = pane.map_scale(picture).stride_m
        await pilot.press("up", "up", "left", "shift+right", "plus", "h")
        new = app._chosen.new_zone
        assert new is not None
        moved = [b - a for a, b in zip(first.centre_m, new.centre_m, strict=True)]
        assert moved == pytest.approx([2 * stride, 4 * stride])
        assert new.radius_m == pytest.approx(first.radius_m + stride)
        assert "Enter opens its order" in text(app)
        await pilot.press("enter")
        (north, east), radius = new.centre_m, new.radius_m
        words = ("add", "zone-1", "circle", f"{north:g}", f"{east:g}", f"{radius:g}")
        await settled(pilot)
        assert f":zone {' '.join(words)}" in text(app)
        await pilot.press("enter")
        assert desk.orders == [Order("hold"), Order("zone", words)]
        await pilot.press("v", "v")
        assert "from the south, E→" in text(app)
        await pilot.press("Z")
        row, column = _find(app, "N↑")
        await pilot.click(offset=(column - 4, row + 1))
        clicked = app._chosen.new_zone
        assert clicked is not None
        assert clicked.centre_m[0] > first.centre_m[0]
        assert clicked.centre_m[1] > first.centre_m[1]
        await pilot.press("escape", "enter")
        assert app._chosen.new_zone is None
        assert len(desk.orders) == 2

    _play(play, size=(160, 50))


@pytest.mark.parametrize("typed", ["hodl", "tune h"])
def test_an_answer_is_never_cut(typed: str) -> None:
    """What would be allowed stands whole on a small screen, on as many lines as it needs."""

    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press("colon", *(NAMES.get(key, key) for key in typed), "enter")
        await settled(pilot)
        assert len(app._notice) > 60
        assert app._notice in " ".join(text(app).split())

    _play(play, size=(60, 20))


def test_the_command_line_completes_refuses_and_remembers() -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press("colon", "f", "o", "tab", "tab")
        await settled(pilot)
        assert ":form hexagon" in text(app)
        await pilot.press("enter")
        assert desk.orders == [Order("form", ("hexagon",))]
        await pilot.press("colon", *"fly", "enter")
        await settled(pilot)
        assert "no command 'fly'; allowed: hold, resume" in text(app)
        await pilot.press("colon", "up", "up", "enter")
        assert desk.orders == [Order("form", ("hexagon",))] * 2
        await pilot.press("colon", *"hold @1,3-4", "enter")
        assert desk.orders[-1] == Order("hold", (), (1, 3, 4))
        await pilot.press("colon", *"land", "escape", "2")
        await settled(pilot)
        assert len(desk.orders) == 3
        assert "mesh links" in text(app)

    _play(play)


NAMES = {":": "colon", " ": "space", "-": "minus", ".": "full_stop", "\t": "tab", "\r": "enter"}


def _at_once(app: Dashboard, characters: str) -> None:
    """All keys in one read of the terminal."""
    for character in characters:
        app.post_message(Key(NAMES.get(character, character), character))


def test_what_is_typed_fast_is_one_line_and_no_single_orders() -> None:
    """Behind `:` as behind the keys that begin a line: `l` alone would land the swarm."""

    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        _at_once(app, ":move 60 -7 2.5\r")
        await settled(pilot)
        assert desk.orders == [Order("move", ("60", "-7", "2.5"))]
        _at_once(app, "fh\t\rm20 10\r:move 1 2\rh")
        await settled(pilot)
        assert desk.orders[1:] == [
            Order("form", ("hexagon",)),
            Order("move", ("20", "10")),
            Order("move", ("1", "2")),
            Order("hold"),
        ]
        _at_once(app, ":ret\t")
        await settled(pilot)
        assert ":ret  " in text(app)
        app.post_message(Key("alt+h", "h"))  # escape and h, read at once
        await settled(pilot)
        assert ":ret" not in text(app)
        assert len(desk.orders) == 5

    _play(play)


@pytest.mark.parametrize(
    ("keys", "kind", "words"),
    [
        ("l", "land", "land agents 1-6: they land where they are"),
        ("b", "return", "return agents 1-6: they fly home, all at once, and land"),
        ("K", "kill", "kill agents 1-6: their motors stop, and they fall"),
        (":kill\r", "kill", "kill agents 1-6: their motors stop, and they fall"),
    ],
)
def test_what_lands_returns_or_kills_asks_and_only_enter_sends_it(
    keys: str, kind: str, words: str
) -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        others = ("n", "y", "space", "l", "colon", "tab", "2") if keys == "K" else ()
        for answer in ("escape", *others):
            _at_once(app, keys)
            await settled(pilot)
            assert words in text(app)
            assert "Enter sends it, Esc drops it." in text(app)
            await pilot.press(answer)
            await settled(pilot)
            assert f"{kind}: not sent" in text(app)
            assert "▴id" in text(app), "the key that drops an order does nothing else"
        assert desk.orders == []
        _at_once(app, keys)
        await shown(app, pilot, replace(PICTURES["well"](), time_s=42.0))
        assert "00:42.0" in text(app), "the picture goes on under the question"
        await pilot.press("enter")
        assert desk.orders == [Order(kind)]

    _play(play)


def test_an_enter_from_before_the_question_was_drawn_is_no_answer() -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        _at_once(app, ":kill @3\r\r")
        await settled(pilot)
        assert "kill agent 3: its motors stop, and it falls" in text(app)
        assert desk.orders == []
        await pilot.press("enter")
        assert desk.orders == [Order("kill", (), (3,))]
        _at_once(app, "line\r")
        await settled(pilot)
        assert {order.kind for order in desk.orders[1:]} <= {"next"}

    _play(play)


def test_next_asks_where_it_leads_to_a_landing() -> None:
    """And it ends the step that the operator saw, whatever step the swarm is in by then."""
    flying = PICTURES["well"]()
    steps = len(steps_of(flying.plan))

    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await shown(app, pilot, replace(flying, step=steps - 1))
        await pilot.press("n")
        await settled(pilot)
        assert f"next agents 1-6: step {steps - 1} ends, and step {steps} is 'land'" in text(app)
        assert desk.orders == []
        await pilot.press("enter")
        assert desk.orders == [Order("next", at_step=steps - 1)]

    _play(play)


def test_ctrl_c_is_the_runs_and_q_leaves_only_a_watcher() -> None:
    async def mine(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press("colon", "ctrl+c")
        await pilot.press("escape", "K")
        await pilot.press("ctrl+c")
        assert desk.interrupts == 1  # the second one asks
        await pilot.press("enter")
        assert desk.interrupts == 2
        await pilot.press("escape", "q")
        await settled(pilot)
        assert "belongs to the run" in text(app)
        assert app.is_running

    async def watching(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press("q")
        assert desk.interrupts == 0
        assert app._exit

    view = PICTURES["well"]()
    _play(mine)
    _play(
        watching,
        replace(view, stations=view.stations | {"station-2": view.time_s - 1.0}),
        owns_run=False,
    )
    _play(watching, PICTURES["ended"](), owns_run=False)


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
def test_the_last_station_asks_before_it_leaves(key: str) -> None:
    """The agents would land without it; the same key again does not wait for an answer."""

    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press(key)
        await settled(pilot)
        assert "leave? No other station is heard: the agents land after 5 s." in text(app)
        await pilot.press("n")
        await settled(pilot)
        assert not app._exit
        await pilot.press(key)
        await settled(pilot)
        await pilot.press("enter" if key == "q" else key)
        await settled(pilot)
        assert app._exit

    _play(play, owns_run=False)


def test_the_log_filters_while_it_is_typed() -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        await pilot.press("slash", *"ekf")
        await settled(pilot)
        assert "EKF variance high" in text(app)
        assert "form hexagon   " not in text(app).split("\n", 3)[3]
        await pilot.press("enter", "escape", "w")
        await settled(pilot)
        assert "22.0" not in text(app)
        await pilot.press("w")
        await settled(pilot)
        assert "nothing passes the filter" in text(app)
        assert desk.orders == []

    _play(play)


def test_light_dark_and_no_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        before = app.current_theme.dark
        await pilot.press("t")
        assert app.current_theme.dark is not before

    async def light(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        assert app.theme == LIGHT

    async def plain(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        assert app.theme == PLAIN
        await pilot.press("t")
        assert app.theme == PLAIN
        strips = app.screen._compositor.render_strips()
        (colours,) = [f for f in app._filters if isinstance(f, NoColor)]
        filtered = [colours.apply(list(strip), app.screen.background_colors[1]) for strip in strips]
        styles = [segment.style for line in filtered for segment in line if segment.style]
        colours_left = {
            colour for style in styles for colour in (style.color, style.bgcolor) if colour
        }
        assert all(colour.is_default for colour in colours_left)

    monkeypatch.setenv("COLORFGBG", "0;15")
    _play(light)
    monkeypatch.delenv("COLORFGBG")
    _play(play)
    monkeypatch.setenv("NO_COLOR", "1")
    _play(plain)
    assert DARK != LIGHT


@pytest.mark.parametrize("title", titles(PLAN))
def test_sorting_keeps_all_agents_and_puts_the_unknown_last(title: str) -> None:
    model = flying_model(hexagon_plan(6))
    model.fold(status_of(PLAN, 4, 30.0, battery_percent=12.0), 30.0)
    view = model.view(30.0)
    waiting = PICTURES["waiting"]()
    for picture in (view, waiting):
        for backwards in (False, True):
            order = in_order(Picture(picture, chosen=Chosen(sort=title, backwards=backwards)))
            assert {agent.id for agent in order} == {1, 2, 3, 4, 5, 6}
    by_charge = in_order(Picture(view, chosen=Chosen(sort="bat%")))
    assert by_charge[0].id == 4
    assert in_order(Picture(waiting, chosen=Chosen(sort="bat%")))[-1].id == 6


HOSTILE = "\x1b[2J\x1b]0;owned\x07[bold red]x[/]\r\n‮31m 漢字 " * 3


def test_nothing_an_agent_says_commands_the_terminal() -> None:
    model = flying_model(PLAN)
    model.fold(status_of(PLAN, 3, 30.0, mode=HOSTILE, reason=HOSTILE, outcome="failed"), 30.0)
    model.fold(status_of(PLAN, 4, 30.0, sigma_tally={HOSTILE: 3}), 30.0)
    model.fold(Event(3, 30.0, "info", HOSTILE), 30.0)
    model.fold(Event(3, 30.0, "warning", f"vehicle: {HOSTILE}"), 30.0)
    model.fold(Command("c", HOSTILE, (), 30.0), 30.0)
    model.fold(Ack(2, "c", False, HOSTILE), 30.0)

    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        for key in ("1", "2", "3", "4"):
            await pilot.press(key)
            await settled(pilot)
            assert all(c.isprintable() for line in text(app).splitlines() for c in line)

    _play(play, model.view(30.0), (160, 40))


def test_what_is_pasted_is_words_of_the_open_line_and_never_an_order() -> None:
    async def play(app: Dashboard, pilot: Pilot[None], desk: Desk) -> None:
        app.post_message(Paste("land\r"))
        _at_once(app, "K")
        app.post_message(Paste("\r"))
        await settled(pilot)
        assert "kill: not sent" in text(app)
        _at_once(app, "m")
        app.post_message(Paste("1 2\r\nK\r\n"))
        _at_once(app, "\r")
        await settled(pilot)
        assert desk.orders == [Order("move", ("1", "2"))]

    _play(play)


def _protected(by: Protection, *signed: int) -> SwarmView:
    view = PICTURES["well"]()
    agents = tuple(
        replace(
            agent,
            status=agent.status
            and replace(
                agent.status, vehicle_link=VehicleLinkReport(1, 0, None, agent.id in signed)
            ),
        )
        for agent in view.agents
    )
    return replace(view, protection=by, agents=agents)


PROTECTED = (
    (
        Protection(MeshKind.TLS, "operator anna", True, True),
        range(1, 7),
        " mesh TLS 6/6 · links signed 6/6 · operator anna",
    ),
    (
        Protection(MeshKind.TLS, "viewer tv", False, True),
        (1, 2),
        " mesh TLS 6/6 · links signed 2/6 · viewer tv",
    ),
    (Protection(MeshKind.OPEN), (), " MESH OPEN · any computer that reaches it may command"),
    (
        Protection(MeshKind.TLS, "operator anna", links_open=True),
        (),
        " mesh TLS 6/6 · LINKS OPEN · operator anna",
    ),
)


def test_what_keeps_others_off_is_on_every_screen() -> None:
    """In the second line of 80 columns; a mesh inside one computer has no such line."""

    async def play(app: Dashboard, pilot: Pilot[None], _: Desk) -> None:
        assert "MESH" not in text(app).upper()
        for by, signed, told in PROTECTED:
            await shown(app, pilot, _protected(by, *signed))
            assert text(app).splitlines()[1].rstrip() == told
        for key in "234":
            await pilot.press(key)
            await settled(pilot)
            assert text(app).splitlines()[1].rstrip() == told

    _play(play)


PARTS = ("title_line", "verdict_line", "protection_line", "answers_line", "Journal.update")


def test_an_error_in_parts_of_the_dashboard_ends_none_of_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each is told in the log, once, and a key still gives its order."""

    def broken(part: str) -> Callable[..., None]:
        def fail(*_: object) -> None:
            raise IndexError(f"{part} out of range")

        return fail

    for part in PARTS:
        monkeypatch.setattr(f"swarm_ctl.station.dashboard.app.{part}", broken(part))

    async def use() -> None:
        async with opened(PICTURES["lost"]()) as (app, pilot, desk):
            await shown(app, pilot, PICTURES["lost"]())
            await pilot.press("h")
            await settled(pilot)
            assert [order.kind for order in desk.orders] == ["hold"]
            told = [entry.text for entry in app._journal.entries]
            for part in PARTS:
                assert sum(f"IndexError: {part} out of range" in text for text in told) == 1, part

    asyncio.run(use())
