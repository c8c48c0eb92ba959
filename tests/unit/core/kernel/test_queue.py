"""One behind the other: where the way has opened, an agent is out of the file for good."""

from __future__ import annotations

from swarm_ctl.core.kernel.queue import OUT, STAYS, along_way, next_on

WAY = [0j, 50 + 0j, 100 + 0j]
ENDS = [0.0, 50.0, 100.0]
HOME = 80 + 8j


def test_an_agent_whose_place_lies_behind_the_opening_is_out_for_good() -> None:
    """Else it went back into the file there, and those behind it waited for it for ever."""
    at = along_way(WAY, ENDS, 85.0, 90 + 0j, 90.0, HOME)
    assert at == OUT
    assert along_way(WAY, ENDS, at, 84 + 6j, 90.0, HOME) == OUT
    assert next_on(80.0, at, 100.0, 8.0) == 86.0
    assert next_on(at, 70.0, 100.0, 8.0) == OUT


def test_one_that_is_heard_in_its_place_alone_is_followed_by_nobody() -> None:
    """Its place lies before the opening, and its words from there were lost."""
    assert along_way(WAY, ENDS, 72.0, HOME + 0.9, 90.0, HOME) == OUT
    assert along_way(WAY, ENDS, 72.0, HOME + 1.1, 90.0, HOME) < 90.0


def test_in_the_file_each_stays_behind_the_one_before_it() -> None:
    assert along_way(WAY, ENDS, 18.0, 20 + 3j, 90.0, HOME) == 20.0
    assert next_on(20.0, 30.0, 100.0, 8.0) == 22.0
    assert next_on(20.0, 28.2, 100.0, 8.0) == STAYS
    assert next_on(20.0, OUT, 100.0, 8.0) == 26.0
