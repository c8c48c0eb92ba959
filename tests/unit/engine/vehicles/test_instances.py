"""No two autopilots of this machine get the same ports."""

from __future__ import annotations

import socket
from itertools import islice

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.launch.ground_control import KNOWN
from swarm_ctl.engine.vehicles import instances
from swarm_ctl.engine.vehicles.instances import UDP, InstancePorts, Instances
from swarm_ctl.errors import StartError

PX4 = VehicleKind.PX4


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ports of this test alone, for three instances."""
    ports = InstancePorts(((UDP, 19210), (instances.TCP, 19220)), 1, (UDP, 19230), 3)
    monkeypatch.setitem(instances.PORTS, PX4, ports)


def test_a_second_run_takes_other_numbers_and_ended_runs_give_theirs_back() -> None:
    with Instances() as one, Instances() as two:
        assert [one.take(PX4), two.take(PX4), one.take(PX4)] == [0, 1, 2]
        with pytest.raises(StartError, match="no px4 can be started: the ports of 3"):
            two.take(PX4)
    with Instances() as later:
        assert later.take(PX4) == 0


def test_no_instance_stands_where_ground_control_software_listens(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A PX4 sends there on another link, so that its agent would hear it twice."""
    monkeypatch.setattr(instances, "GCS_PORT", 19211)
    with Instances() as ours:
        assert [ours.take(PX4), ours.take(PX4)] == [0, 2]


def test_no_simulated_vehicle_stands_there_either() -> None:
    for known in KNOWN.values():
        clients = [known.client(i) for i in islice(known.numbers(), 20)]
        assert len({*clients}) == 20
        assert not [client for client in clients if client.endswith(f":{instances.GCS_PORT}")]
    assert KNOWN["px4"].client(10).endswith(f":{instances.GCS_PORT}"), "else nothing is left out"


@pytest.mark.parametrize(("kind", "port"), [(UDP, 19210), (instances.TCP, 19220)])
def test_ports_of_another_program_are_left_to_it(kind: socket.SocketKind, port: int) -> None:
    with socket.socket(socket.AF_INET, kind) as other, Instances() as ours:
        other.bind(("127.0.0.1", port))
        assert ours.take(PX4) == 1
