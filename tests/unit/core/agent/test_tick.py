"""What an agent counts as silence: only the time in which it ran itself, and half a second of each
stop."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.tick import ASLEEP_S, Attention

TICK_S = 0.05


def ran(*spans: tuple[float, float]) -> Attention:
    """An agent that ran in these spans of time, and not between them."""
    attention = Attention()
    for begin, end in spans:
        for k in range(round((end - begin) / TICK_S) + 1):
            attention.run(begin + k * TICK_S)
    return attention


@pytest.mark.parametrize(
    ("since_s", "awake_s"),
    [(0.0, 4.5), (2.0, 2.5), (3.0, 1.5), (8.0, 1.0), (13.5, 0.5), (-math.inf, math.inf)],
)
def test_a_stop_of_ten_seconds_is_no_silence(since_s: float, awake_s: float) -> None:
    attention = ran((0.0, 3.0), (13.0, 14.0))
    assert attention.awake_s(since_s, 14.0) == pytest.approx(awake_s)


def test_a_late_tick_is_none() -> None:
    attention = ran((0.0, 3.0), (3.0 + ASLEEP_S, 4.0))
    assert attention.awake_s(0.0, 4.0) == pytest.approx(4.0)


@given(stops=st.lists(st.floats(0.6, 20.0), max_size=5), since=st.floats(0.0, 5.0))
def test_silence_adds_up_over_stops(stops: list[float], since: float) -> None:
    """An agent that is stopped again and again still finds a dead vehicle."""
    spans, at = [], 0.0
    for stop in (0.0, *stops):
        spans.append((at + stop, at + stop + 1.0))
        at += stop + 1.0
    awake = ran(*spans).awake_s(min(since, at), at)
    assert 0.0 <= awake <= at - min(since, at) + 1e-9
    assert ran(*spans).awake_s(0.0, at) == pytest.approx(1.0 + (1.0 + ASLEEP_S) * len(stops))


def test_silence_is_found_on_a_machine_that_is_slow_for_good() -> None:
    """With a tick each 0.6 s, an agent still finds that its vehicle has been silent for 5 s."""
    attention = Attention()
    for k in range(11):
        attention.run(0.6 * k)
    assert attention.awake_s(0.0, 6.0) == pytest.approx(5.0)
