"""An agent's lifeline: never blocks, and knows when the parent is gone."""

from __future__ import annotations

import multiprocessing
import os
import sys

from swarm_ctl.engine.lifeline import ChildWords, PipeLifeline


def test_lifeline_is_cut_when_the_parent_closes_it() -> None:
    ours, theirs = multiprocessing.Pipe()
    lifeline = PipeLifeline(theirs.fileno(), theirs.fileno())
    assert not lifeline.cut()
    ours.send_bytes(b"anything")
    assert not lifeline.cut()
    ours.close()
    assert lifeline.cut()
    theirs.close()


def test_telling_a_parent_that_does_not_read_never_blocks() -> None:
    """A stopped parent must not stop the control loop."""
    ours, theirs = multiprocessing.Pipe()
    lifeline = PipeLifeline(theirs.fileno(), theirs.fileno())
    for _ in range(100_000):  # far more than any socket buffer takes
        lifeline.tell("alive")
    assert not lifeline.cut()
    ours.close()
    theirs.close()


def test_a_parent_hears_each_word_whole_and_none_twice() -> None:
    ours, theirs = multiprocessing.Pipe()
    words, lifeline = ChildWords(ours), PipeLifeline(theirs.fileno(), theirs.fileno())
    assert words.next() is None
    lifeline.tell("ready")
    lifeline.tell("it broke:\nin two lines")
    assert [words.next() for _ in range(3)] == ["ready", "it broke: in two lines", None]
    lifeline.tell("last")
    theirs.close()
    assert [words.next() for _ in range(2)] == ["last", None]
    ours.close()
    assert words.next() is None


class Evil:
    """Runs code where it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (exec, ("import sys; sys.was_harmed = True",))


def test_what_a_child_tells_runs_no_code_in_its_parent_and_keeps_it_waiting_never() -> None:
    """A child that was taken over sends a pickle, half a message, and a line without an end."""
    ours, theirs = multiprocessing.Pipe()
    words = ChildWords(ours)
    theirs.send(Evil())
    os.write(theirs.fileno(), b"\n")
    assert words.next() is not None
    assert not hasattr(sys, "was_harmed")
    os.write(theirs.fileno(), b"\x7f\xff")
    assert words.next() is None
    os.write(theirs.fileno(), b"x" * 100_000)
    heard = [words.next() for _ in range(200)]
    assert 0 < sum(len(word) for word in heard if word) <= 100_002
    ours.close()
    theirs.close()
