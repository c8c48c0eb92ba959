"""A command is carried out once, while it is new, whatever order commands come in."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.command_handler import CommandOrigins
from swarm_ctl.core.model.messages import Command

NOW = 100.0
SENT = Command("c", "land", (), NOW, station="anna", number=1)


@pytest.mark.parametrize(
    ("time_s", "ahead_s", "why"),
    [
        (NOW, (), ""),
        (NOW - 14.9, (), ""),
        (NOW - 40.0, (), "it is 40 s old, by its sender's clock; allowed: 15 s"),
        (NOW + 16.0, (), "it is from 16 s ahead, by its sender's clock"),
        (NOW - 3600.0, ((3, 3600.0),), ""),
        (NOW - 3600.0, ((2, 3600.0),), "it is 3600 s old"),
        (float("nan"), (), "it is"),
    ],
)
def test_an_old_command_is_refused(
    time_s: float, ahead_s: tuple[tuple[int, float], ...], why: str
) -> None:
    """By the sender's clock, as far as that is known to differ from the own one."""
    found = CommandOrigins(3, 1.0).refusal(replace(SENT, time_s=time_s, ahead_s=ahead_s), NOW)
    assert found.startswith(why)
    assert bool(found) is bool(why)


def test_a_sender_waits_by_the_wall_clock() -> None:
    """Ten seconds of it are 40 s of mission time."""
    assert CommandOrigins(3, 4.0).refusal(replace(SENT, time_s=NOW - 40.0), NOW) == ""


def test_a_command_without_a_number_is_refused() -> None:
    assert "number 0 of anna" in CommandOrigins(3, 1.0).refusal(replace(SENT, number=0), NOW)


@given(st.permutations(range(1, 30)), st.integers(1, 29))
def test_each_number_counts_once(order: list[int], again: int) -> None:
    """In any order; a number that was used is refused, and another station's is not."""
    origins = CommandOrigins(3, 1.0)
    for number in order:
        assert origins.refusal(replace(SENT, number=number), NOW) == ""
    assert "was used by another command" in origins.refusal(replace(SENT, number=again), NOW)
    assert origins.refusal(replace(SENT, number=again, station="bob"), NOW) == ""


def test_a_number_that_was_forgotten_is_refused() -> None:
    """Only the newest are kept, and so few stations that no flood of them takes memory."""
    origins = CommandOrigins(3, 1.0)
    for number in range(1, 200):
        origins.refusal(replace(SENT, number=number), NOW)
    assert origins.refusal(replace(SENT, number=2), NOW) != ""
    for k in range(1000):
        origins.refusal(replace(SENT, station=str(k)), NOW)
    assert len(origins._numbers) <= 64
