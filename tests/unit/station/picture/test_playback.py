"""A recorded flight from any moment: the same picture however one came there, and the alarms of the
live station."""

from __future__ import annotations

from collections import deque
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.errors import InputError
from swarm_ctl.station.picture.alarms import Level, alarms
from swarm_ctl.station.picture.journal import Journal
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.playback import LOOK_S, Film, Mark
from tests.unit.station.recorded import (
    COMMAND_S,
    END_S,
    PLAN,
    SILENT_S,
    START_S,
    film,
    said,
    scenes,
)


@cache
def whole() -> Film:
    """Read to its end."""
    made = film()
    made.read_ahead(lambda: False)
    return made


def test_a_film_tells_what_the_live_station_told() -> None:
    """Every line of the log and every alarm of the last view, from a model and a journal fed by
    hand."""
    model, journal, messages = Model(PLAN, since_s=START_S), Journal(), deque(said())
    first_s = messages[0][0]
    for look in range(int((END_S - START_S) / LOOK_S) + 2):
        now_s = first_s + look * LOOK_S
        while messages and messages[0][0] <= now_s:
            heard_s, payload = messages.popleft()
            model.fold(payload, heard_s)
        journal.update(model.view(now_s))
        if look == 100:
            made = film()
            made.seek(now_s)
            assert made.journal.entries == journal.entries
            assert (
                [a.key for a in alarms(made.view())]
                == [a.key for a in journal.standing]
                == [("silent", (3,))]
            )
    made = film()
    made.seek(END_S + 1.0)
    assert made.journal.entries == journal.entries
    assert any("agent 3: not heard" in entry.text for entry in journal.entries)


@settings(max_examples=8, deadline=None)
@given(st.lists(st.floats(START_S - 1.0, END_S + 1.0), min_size=1, max_size=4))
def test_a_moment_is_the_same_however_one_came_there(times_s: list[float]) -> None:
    """Back and forth over keyframes, or straight from the start without any."""
    for time_s in times_s:
        whole().seek(time_s)
    straight = film()
    straight.seek(times_s[-1])
    assert straight.time_s == whole().time_s
    assert straight.view() == whole().view()
    assert straight.journal.entries == whole().journal.entries


def test_a_way_forwards_may_end_early() -> None:
    """Playing on a machine that is too slow: it stops at a look, and goes on from there."""
    made = film()
    calls = iter([False, False, True])
    made.seek(END_S, lambda: next(calls))
    assert made.time_s == pytest.approx(made.start_s + 3 * LOOK_S)
    made.seek(END_S + 1.0)
    assert made.time_s == made.end_s


def test_marks_are_where_the_log_got_longer() -> None:
    """Events, alarms, orders and steps at the look that told them, found from both sides."""
    kinds = {mark.kind for mark in whole().marks}
    assert kinds == {"step", "alarm", "cleared", "vehicle", "command"}

    def bad(mark: Mark) -> bool:
        return mark.level >= Level.WARNING

    whole().seek(START_S)
    first_s = whole().next_mark(lambda mark: mark.kind == "alarm" and bad(mark))
    assert first_s is not None
    assert SILENT_S[0] < first_s < SILENT_S[1]
    whole().seek(first_s)
    assert whole().journal.entries[-1].kind == "alarm"
    whole().seek(45.0)
    battery_s = whole().last_mark(bad)
    assert battery_s is not None
    assert 40.0 <= battery_s <= 40.0 + LOOK_S
    assert whole().next_mark(lambda mark: mark.kind == "command") == pytest.approx(
        COMMAND_S, abs=LOOK_S
    )
    whole().seek(whole().end_s)
    assert whole().next_mark(lambda _: True) is None
    whole().seek(whole().start_s)
    assert whole().last_mark(lambda _: True) is None


def test_times_as_they_are_typed() -> None:
    whole().seek(30.0)
    wanted = {
        "33": 33.0,
        "1:02.5": 62.5,
        "+10": 40.0,
        "-0:10": 20.0,
        "start": whole().start_s,
        "end": whole().end_s,
    }
    assert {text: whole().moment(text) for text in wanted} == pytest.approx(wanted)
    for text in ("", "x", "1:", ":5", "1:2:3", "nan", "1e3", "--4"):
        with pytest.raises(InputError, match=r"allowed: seconds, MIN:SEC"):
            whole().moment(text)


@pytest.mark.parametrize("nothing", [[], [[]], [[], []]])
def test_no_message_is_no_film(nothing: list[list[tuple[float, object]]]) -> None:
    with pytest.raises(InputError, match="no message"):
        Film(nothing, PLAN)  # type: ignore[arg-type]


def test_one_message_is_a_film() -> None:
    one = Film([scenes()[1][:1]], PLAN)
    assert one.start_s == one.end_s == one.time_s
    assert one.read_ahead(lambda: False)
    assert one.view().agents[0].phase is not None
