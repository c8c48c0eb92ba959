"""The pipe between `run` and its station, and an agent's lifeline: never block, know when the other
end is gone."""

from __future__ import annotations

import multiprocessing
import os
import socket

from swarm_ctl.runtime.agent.lifeline import PipeLifeline
from swarm_ctl.runtime.launch.ports import free_ports
from swarm_ctl.runtime.station.control_pipe import ControlPipe


def test_messages_in_pieces() -> None:
    """Lines torn by the pipe are put together; what is no JSON object is passed over; the end is
    seen."""
    read, write = os.pipe()
    pipe = ControlPipe(read)
    assert pipe.poll() == []
    os.write(write, b'{"command": "la')
    assert pipe.poll() == []
    os.write(write, b'nd"}\nnonsense\n[1]\n{"finish": true}\n')
    assert pipe.poll() == [{"command": "land"}, {"finish": True}]
    assert not pipe.closed
    os.close(write)
    assert pipe.poll() == []
    assert pipe.closed
    os.close(read)


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


def test_free_ports_are_free_and_different() -> None:
    """Each can be bound at once, and none that is taken is offered."""
    taken = free_ports(1, socket.SOCK_STREAM)[0]
    with socket.create_server(("127.0.0.1", taken)):
        ports = free_ports(20, socket.SOCK_STREAM)
        assert len(set(ports)) == 20
        assert taken not in ports
        servers = [socket.create_server(("127.0.0.1", port)) for port in ports]
        for server in servers:
            server.close()
