"""The pipe from `run` to its station: never blocks, and knows when `run` is gone."""

from __future__ import annotations

import os
from pathlib import Path
from unittest.mock import Mock

import pytest

from swarm_ctl.engine.lockstep.seat import Seat
from swarm_ctl.engine.script import ScriptedOrder, StationScript
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.station_loop import ControlPipe, RunControl
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from tests.unit.report.run_folders import PLAN


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


@pytest.mark.parametrize("broken_off", [True, False])
def test_a_run_that_is_broken_off_gives_no_more_orders_of_its_scenario(
    broken_off: bool, tmp_path: Path
) -> None:
    """They would be refused on the way down, and the run would have failed by Ctrl-C."""
    hub = MemoryHub(lambda: 1.0)
    agent = Node(MemoryTransport(hub), "swarm", 1)
    agent.listen(keys.COMMAND)
    seat = Mock(Seat, clock=Mock(now=lambda: 1.0, speedup=1.0))
    station = Station(PLAN, Node(MemoryTransport(hub), "swarm", "station"), seat.clock)
    read, write = os.pipe()
    script = StationScript((ScriptedOrder(0.5, "hold"),))
    control = RunControl(ControlPipe(read), seat, tmp_path, script)
    os.write(write, b'{"command": "land"}\n' * broken_off)
    assert not control.obey(station, Mock())
    control.end(station, Mock())
    assert [word.kind for word, _ in agent.take(keys.COMMAND)] == ["land" if broken_off else "hold"]
    os.close(write)
    os.close(read)
