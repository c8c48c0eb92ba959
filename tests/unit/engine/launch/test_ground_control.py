"""Where ground control software finds simulated vehicles: each port belongs to one run."""

from __future__ import annotations

import socket

import pytest

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.engine.launch import ground_control
from swarm_ctl.engine.launch.ground_control import GroundControl, KnownPort
from swarm_ctl.engine.vehicles.instances import TCP, UDP

FLEET = [FleetAgent(i, i, "ardupilot", f"udpout:127.0.0.1:{19000 + i}") for i in (1, 2)]
PX4S = [FleetAgent(i, i, "px4", f"udpout:127.0.0.1:{19000 + i}") for i in (1, 2)]


@pytest.fixture(autouse=True)
def ours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ports of this test alone."""
    monkeypatch.setitem(ground_control.KNOWN, "ardupilot", KnownPort(19310, 10, (UDP, 19310)))
    monkeypatch.setitem(ground_control.KNOWN, "px4", KnownPort(19340, 1, (TCP, 19380), 19380))


def chosen(fleet: list[FleetAgent]) -> GroundControl:
    return ground_control.ground_control(fleet, [1, 2], [])


@pytest.mark.parametrize("fleet", [FLEET, PX4S], ids=["ardupilot", "px4"])
def test_of_two_runs_that_start_together_one_has_the_port(fleet: list[FleetAgent]) -> None:
    """No simulator has bound anything yet: the table of the second one says that it is taken, and
    its simulator does not try. When the first has ended, the next one has it."""
    first, second = chosen(fleet), chosen(fleet)
    assert not any(text.endswith("is taken") for text in first.known.values())
    assert second.known == {agent: f"{text} is taken" for agent, text in first.known.items()}
    assert not any(second.further.values())
    first.held.close()
    third = chosen(fleet)
    assert third.known == first.known
    assert third.further == first.further
    third.held.close()


def test_a_port_of_another_program_is_left_to_it() -> None:
    """And nothing of that number is held."""
    with socket.create_server(("127.0.0.1", 19320)):
        found = chosen(FLEET)
    assert found.known[2] == "tcp:127.0.0.1:19320 is taken"
    with socket.socket(socket.AF_INET, UDP) as probe:
        probe.bind(("127.0.0.1", 19320))
    found.held.close()
