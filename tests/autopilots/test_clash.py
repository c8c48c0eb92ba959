"""Two ArduCopters with one system id on one link: the agent stays on the ground and names them."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.vehicles.order import Started
from swarm_ctl.mavlink.framer import Framer
from swarm_ctl.mavlink.wires import open_wire
from tests.autopilots.sitl import Client, alone, standing
from tests.system.running import Running

SYSID = 7
NAMED = f"two vehicles speak with system id {SYSID} on this link: give one of them another"


@contextlib.contextmanager
def joined(vehicles: list[Started]) -> Iterator[str]:
    """One link to all of them, as with one radio: the endpoint of its agent."""
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    agent = open_wire(f"udpout:127.0.0.1:{port}")
    wires = [(open_wire(vehicle.endpoint), Framer()) for vehicle in vehicles]
    ended = threading.Event()

    def carry() -> None:
        now = time.monotonic()
        while (chunk := agent.read(now)) is not None:
            for wire, _ in wires:
                wire.write(chunk, now)
        for wire, framer in wires:
            while (chunk := wire.read(now)) is not None:
                for frame in framer.feed(chunk):
                    agent.write(frame.raw, now)

    def carry_on() -> None:
        while not ended.wait(0.005):
            with contextlib.suppress(OSError):  # the agent is not there yet, or no longer
                carry()

    thread = threading.Thread(target=carry_on, daemon=True)
    thread.start()
    try:
        yield f"udpin:127.0.0.1:{port}"
    finally:
        ended.set()
        thread.join()
        for wire in (agent, *(wire for wire, _ in wires)):
            wire.close()


@pytest.mark.long
def test_two_vehicles_of_one_system_id_on_one_link_stay_on_the_ground(tmp_path: Path) -> None:
    kinds = [VehicleKind.ARDUCOPTER] * 2
    with (
        standing(kinds, tmp_path / "vehicles", sysids=(SYSID, SYSID)) as started,
        joined([*started.values()]) as endpoint,
        Client(started[1]) as one,
        Client(started[2]) as other,
        Running(
            *("run", alone(tmp_path, started[1], endpoint), "--headless", "--no-report"),
            cwd=tmp_path,
        ) as run,
    ):
        begun_s = time.monotonic()
        run.wait_for(lambda: NAMED in run.output)
        print(f"named after {time.monotonic() - begun_s:.1f} s")
        while run.process.poll() is None:
            assert not any((one.armed, other.armed))
            time.sleep(0.1)
        assert run.process.returncode == 1
        assert f"not ready: {NAMED}" in run.summary()["reason"]
        run.assert_nothing_left()
