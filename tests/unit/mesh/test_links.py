"""The links of a name: those in excess are ended, however many come at a time."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing
from types import SimpleNamespace
from typing import Any

import pytest

from swarm_ctl.mesh import links
from swarm_ctl.mesh.links import OF_A_NAME, Links, Sockets

NAME = "viewer-tv.sw.e1"
COUNT = 40
BOUND_S = 20.0

Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def pairs(opened: ExitStack, count: int) -> list[Pair]:
    """TCP connections: the other end, and this process's."""
    server = opened.enter_context(socket.create_server(("127.0.0.1", 0)))
    made = []
    for _ in range(count):
        there = opened.enter_context(socket.create_connection(server.getsockname()))
        made.append((there, opened.enter_context(server.accept()[0])))
    return made


def link(pair: Pair) -> Any:
    """As zenoh tells of it."""
    host, port = pair[0].getsockname()
    return SimpleNamespace(auth_identifier=NAME, zid=port, dst=f"tls/{host}:{port}")


def test_a_link_in_excess_is_ended_and_zenoh_s_thread_never_waits(
    opened: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While one look at the sockets goes on, all others come; then a few looks are for all."""
    free, looks, look = threading.Event(), list[int](), Sockets.look

    def slow(self: Sockets, new: Any) -> None:
        assert free.wait(BOUND_S)
        looks.append(threading.get_ident())
        look(self, new)

    monkeypatch.setattr(Sockets, "look", slow)
    made = pairs(opened, COUNT)
    with closing(Links()) as ours:
        for each in made:
            ours.heard(link(each), ended=False)
        free.set()
        for there, _ in made[OF_A_NAME:]:
            there.settimeout(BOUND_S)
            assert there.recv(1) == b""
        for there, _ in made[:OF_A_NAME]:
            there.setblocking(False)
            with pytest.raises(BlockingIOError):
                there.recv(1)
        assert len(looks) <= 3
        assert threading.get_ident() not in looks
        (told,) = ours.refused(1.0)
        assert told.count == COUNT - OF_A_NAME


def test_each_socket_is_looked_at_once_and_another_one_at_its_descriptor_again(
    opened: ExitStack,
) -> None:
    made, sockets, seen = pairs(opened, 3), Sockets(), list[int]()

    def new(one: socket.socket) -> None:
        seen.append(os.fstat(one.fileno()).st_ino)

    def found(*pairs: Pair) -> list[int]:
        sockets.look(new)
        inodes = [os.fstat(each.fileno()).st_ino for pair in pairs for each in pair]
        counts = [seen.count(inode) for inode in inodes]
        seen.clear()
        return counts

    assert found(*made) == [1] * 6
    assert found(*made) == [0] * 6
    places = {each.fileno() for each in made[0]}
    for each in made[0]:
        each.close()
    again = pairs(opened, 2)
    assert places & {each.fileno() for pair in again for each in pair}
    assert found(*again, *made[1:]) == [1] * 4 + [0] * 4


def test_only_the_connection_that_is_named_is_shut(opened: ExitStack) -> None:
    (one, other), sockets = pairs(opened, 2), Sockets()
    sockets.look(lambda _: None)
    sockets.shut({links._address(link(one).dst)})
    one[0].settimeout(BOUND_S)
    assert one[0].recv(1) == b""
    other[1].sendall(b"x")
    assert other[0].recv(1) == b"x"
