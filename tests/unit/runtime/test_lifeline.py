"""An agent's lifeline: never blocks, and knows when the parent is gone."""

from __future__ import annotations

import multiprocessing

from swarm_ctl.runtime.lifeline import PipeLifeline


def test_lifeline_is_cut_when_the_parent_closes_it() -> None:
    ours, theirs = multiprocessing.Pipe()
    lifeline = PipeLifeline(theirs)
    assert not lifeline.cut()
    ours.send_bytes(b"anything")
    assert not lifeline.cut()
    ours.close()
    assert lifeline.cut()
    theirs.close()


def test_telling_a_parent_that_does_not_read_never_blocks() -> None:
    """A stopped parent must not stop the control loop."""
    ours, theirs = multiprocessing.Pipe()
    lifeline = PipeLifeline(theirs)
    for _ in range(100_000):  # far more than any socket buffer takes
        lifeline.tell("alive")
    assert not lifeline.cut()
    ours.close()
    theirs.close()
