"""The pipe from `run` to its station: never blocks, and knows when `run` is gone."""

from __future__ import annotations

import os

from swarm_ctl.engine.station.station_loop import ControlPipe


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
