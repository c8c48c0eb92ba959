"""A session that opens late: what it lacks, its user is told, and nothing works by half."""

from __future__ import annotations

import threading
from typing import Any
from unittest.mock import Mock

import pytest
import zenoh

from swarm_ctl.mesh import late_session
from swarm_ctl.mesh.late_session import LateSession


def test_what_can_not_be_declared_leaves_no_half_mesh(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A session of which one declaration fails is closed, and said to be none: a publisher that was
    declared before it drops, and a subscriber hears nothing."""
    monkeypatch.setattr(late_session, "_WAIT_WALL_S", 0.01)
    opens, closed, session = threading.Event(), threading.Event(), Mock()
    session.declare_subscriber.side_effect = zenoh.ZError("no room")
    session.close.side_effect = closed.set

    def open_session() -> Any:
        opens.wait()
        return session

    late = LateSession(open_session)
    publisher, subscriber = late.declare_publisher("a"), late.declare_subscriber("b")
    opens.set()
    assert closed.wait(10.0)
    publisher.put(b"")
    assert subscriber.try_recv() is None
    assert session.declare_publisher.call_count == 1
    assert session.declare_publisher.return_value.put.call_count == 0
    assert late.declare_subscriber("c").try_recv() is None
    assert capfd.readouterr().err == "the mesh does not open: no room\n"


def test_a_closed_session_tries_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before its router comes it tries again and again; from `close` on not once more, so that no
    later router hears of it."""
    monkeypatch.setattr(late_session, "_WAIT_WALL_S", 0.01)
    tries, goes_on = threading.Semaphore(0), threading.Semaphore(0)

    def open_session() -> Any:
        tries.release()
        goes_on.acquire()

    late = LateSession(open_session)
    for _ in range(3):
        assert tries.acquire(timeout=10.0)
        goes_on.release()
    assert tries.acquire(timeout=10.0)
    late.close()
    goes_on.release()
    assert not tries.acquire(timeout=0.2)
