"""Reception: what was lost, what was only late, how old things become."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.station.picture.link_stats import Receiver


def test_age_is_time_since_receipt_plus_time_under_way() -> None:
    receiver = Receiver()
    receiver.hear(1, sent_s=10.0, received_s=10.02)
    assert receiver.report(10.5).age_s == pytest.approx(0.5)


def test_a_foreign_clock_that_answers_is_known() -> None:
    """0.1 s there and back: a state that took 0.04 s is taken for 0.05 s old, whatever the clock
    shows."""
    receiver = Receiver()
    receiver.hear(1, sent_s=-49.0, received_s=10.04)
    receiver.answered(10.0, -48.95, -48.9, 10.2)
    receiver.hear(2, sent_s=-48.0, received_s=11.04)
    report = receiver.report(11.5)
    assert report.clock_ahead_s == pytest.approx(-59.0, abs=0.06)
    assert report.age_s == pytest.approx(0.5, abs=0.06)


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.data())
def test_received_and_lost_tell_what_happened_whatever_the_order(
    arrives: list[bool], data: st.DataObject
) -> None:
    """Messages vanish, come twice and out of order: received + lost spans the numbers heard, each
    counted once."""
    sent = [seq for seq, kept in enumerate(arrives) if kept]
    repeated = data.draw(st.lists(st.sampled_from(sent), max_size=5)) if sent else []
    order = data.draw(st.permutations(sent + repeated))
    receiver = Receiver()
    for k, seq in enumerate(order):
        receiver.hear(seq, sent_s=0.05 * seq, received_s=3.0 + 0.001 * k)
    report = receiver.report(4.0)
    # what came before the first one heard is unknown to a station that starts in mid-flight
    known = [seq for seq in sent if seq >= order[0]] if order else []
    assert report.received == len(known)
    assert report.lost == (known[-1] - known[0] + 1 - len(known) if known else 0)


def test_loss_and_age_forget_what_is_over() -> None:
    receiver = Receiver()
    for k in range(200):
        if not 20 <= k < 60:
            receiver.hear(k, 0.05 * k, 0.05 * k)
    bad = receiver.report(9.95)
    assert bad.recent_loss == pytest.approx(40 / 199)
    assert bad.age_p99_s == pytest.approx(2.05)
    for k in range(200, 440):
        receiver.hear(k, 0.05 * k, 0.05 * k)
    good = receiver.report(0.05 * 439)
    assert (good.recent_loss, good.lost) == (0.0, 40)
    assert good.age_p99_s == pytest.approx(0.05)
