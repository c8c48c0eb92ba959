"""Replaying on the dashboard: keys and clicks of a player, and that nothing can be ordered."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from textual.pilot import Pilot

from swarm_ctl.commands.parse import KINDS
from swarm_ctl.station.dashboard.player import Player, clock
from tests.on_demand import on_demand
from tests.unit.station.recorded import SILENT_S, film
from tests.unit.station.screens import settled, text


class Watch:
    """A clock that goes when it is told to."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


Play = Callable[[Player, Pilot[None], Watch], Awaitable[None]]


def _play(
    play: Play, size: tuple[int, int] = (100, 30), *, speed: float = 1.0, read: bool = True
) -> None:
    async def go() -> None:
        watch, made = Watch(), film()
        if read:
            made.read_ahead(lambda: False)
        app = Player(made, watch, speed=speed)
        async with app.run_test(size=size) as pilot:
            app.turn()
            await settled(pilot)
            await play(app, pilot, watch)

    asyncio.run(go())


def _pass(app: Player, watch: Watch, seconds: float) -> None:
    watch.now_s += seconds
    app.turn()


def test_it_ends_while_a_picture_is_due() -> None:
    """Its widgets go one by one; what is left is not drawn on."""

    async def play(app: Player, pilot: Pilot[None], watch: Watch) -> None:
        await app.query_one("#title").remove()
        _pass(app, watch, 1.0)
        await settled(pilot)

    _play(play)


def test_it_plays_as_fast_as_asked_and_stays_on_the_last_picture() -> None:
    async def play(app: Player, pilot: Pilot[None], watch: Watch) -> None:
        begin_s = app.film.time_s
        _pass(app, watch, 2.0)
        assert app.film.time_s == pytest.approx(begin_s + 4.0)
        await pilot.press("plus")
        _pass(app, watch, 2.0)
        assert app.film.time_s == pytest.approx(begin_s + 14.0)
        await pilot.press("minus", "minus", "minus")
        _pass(app, watch, 2.0)
        assert app.film.time_s == pytest.approx(begin_s + 15.0)
        await pilot.press("0", *["equals_sign"] * 9)
        assert "×50" in text(app)
        _pass(app, watch, 10.0)
        await settled(pilot)
        assert app.film.time_s == app.film.end_s
        assert not app.playing.going
        assert app.is_running
        assert f"■ {clock(app.film.end_s)}" in text(app)
        await pilot.press("space")
        assert app.film.time_s == app.film.start_s
        assert app.playing.going

    _play(play, speed=2.0)


def test_pause_and_seek() -> None:
    async def play(app: Player, pilot: Pilot[None], watch: Watch) -> None:
        await pilot.press("space")
        begin_s = app.film.time_s
        _pass(app, watch, 5.0)
        assert app.film.time_s == begin_s
        await pilot.press(
            "right", "right", "shift+right", "left", "full_stop", "full_stop", "comma"
        )
        assert app.film.time_s == pytest.approx(begin_s + 35.25)
        await pilot.press("colon", *"25", "enter")
        assert app.film.time_s == 25.0
        await settled(pilot)
        assert "✗ agent 3: not heard for" in text(app).splitlines()[1], text(app)
        assert "00:25.0" in text(app).splitlines()[0]
        await pilot.press("colon", *"1", "colon", *"02", "enter")
        assert app.film.time_s == 62.0
        await pilot.press("home")
        assert app.film.time_s == app.film.start_s
        await pilot.press("end")
        assert app.film.time_s == app.film.end_s
        await pilot.press("colon", *"soon", "enter")
        await settled(pilot)
        assert "time 'soon'; allowed: seconds, MIN:SEC" in text(app)

    _play(play)


def test_from_event_to_event_and_from_alarm_to_alarm() -> None:
    async def play(app: Player, pilot: Pilot[None], watch: Watch) -> None:
        await pilot.press("space", "a")
        assert SILENT_S[0] < app.film.time_s < SILENT_S[1]
        assert app.film.journal.entries[-1].text == "agent 3: its last state is 1.0 s old"
        alarm_s = app.film.time_s
        await pilot.press("e", "E")
        assert app.film.time_s == alarm_s
        await pilot.press("a", "a", "a", "a", "a", "a")
        await settled(pilot)
        assert "no alarm after this moment" in text(app)
        await pilot.press("home", "E")
        await settled(pilot)
        assert "no event before this moment" in text(app)

    _play(play)


def test_nothing_can_be_ordered() -> None:
    """Every order's key and every order typed is answered with why not; no question is asked."""

    async def play(app: Player, pilot: Pilot[None], watch: Watch) -> None:
        for kind in KINDS:
            await pilot.press(kind.key)
            await settled(pilot)
            assert f"{kind.name}: this is a recording: nothing can be ordered" in text(app)
            assert len(app.screen_stack) == 1
        await pilot.press("colon", *"land", "enter")
        await settled(pilot)
        assert "land: this is a recording" in text(app)

    _play(play)


def test_what_is_not_read_yet_is_gone_to_when_it_is() -> None:
    """The clock stands still while reading; the wish is kept, and shown."""

    class Hasty(Watch):
        """A second passes with every look at it: no time for anything."""

        def __call__(self) -> float:
            self.now_s += 1.0
            return self.now_s

    async def go() -> None:
        watch = Hasty()
        app = Player(film(), watch, going=False)
        async with app.run_test(size=(100, 30)) as pilot:
            app.action_seek(60.0)
            await settled(pilot)
            assert "→ 01:00.0" in text(app)
            assert app.film.time_s == app.film.start_s
            app._wall_s = Watch()
            app.turn()
            await settled(pilot)
            assert app.film.time_s == 60.0
            assert "→" not in text(app).splitlines()[-2]

    asyncio.run(go())


@pytest.mark.parametrize("size", [(20, 6), on_demand((40, 12)), (80, 24), (250, 80)])
def test_it_fits_wherever_it_is_drawn(size: tuple[int, int]) -> None:
    async def play(app: Player, pilot: Pilot[None], watch: Watch) -> None:
        for key in ("1", "4", "question_mark"):
            await pilot.press(key)
            await settled(pilot)
            assert {len(line) for line in text(app).splitlines()} == {size[0]}
            if size[0] >= 80:
                assert "REPLAY" in text(app)

    _play(play, size)
