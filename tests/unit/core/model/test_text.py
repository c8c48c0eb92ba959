"""Words for a terminal."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.text import agents_counted, printable, ranges


@given(st.text())
def test_printable_text_has_no_control_characters_and_a_limit(text: str) -> None:
    shown = printable(text, 20)
    assert all(c.isprintable() for c in shown)
    assert len(shown) <= 20
    if text.isprintable() and len(text) <= 20:
        assert shown == text


@given(st.sets(st.integers(1, 60)))
def test_ranges_name_every_number_and_no_other(numbers: set[int]) -> None:
    named: set[int] = set()
    for span in filter(None, ranges(numbers).split(", ")):
        first, _, last = span.partition("-")
        named |= set(range(int(first), int(last or first) + 1))
    assert named == numbers


def test_many_agents_are_counted_where_their_ids_take_too_much_room() -> None:
    assert agents_counted(range(1, 101)) == "agents 1-100"
    assert agents_counted(range(1, 101, 2)) == "50 agents"
