"""The plug of a vehicle's serial port, pulled out and put in again: real processes, two vehicles at
pseudo-terminals whose names stay."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.engine.launch.ports import free_ports
from tests.system.pair import BARE
from tests.system.running import SWARM_CTL, Running

pytestmark = pytest.mark.timeout(200)
GAP_S = 0.5
DEVICES = Path("/dev/shm")  # noqa: S108
MISSION = BARE.replace("  - land", "  - hold: {duration_s: 10}\n  - land")


class Cable:
    """Between a named serial port and a vehicle at a UDP port."""

    def __init__(self, name: Path, port: int) -> None:
        self.name = name
        self._vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle.connect(("127.0.0.1", port))
        self._vehicle.setblocking(False)
        self._lock, self._end = threading.Lock(), threading.Event()
        self._here = self._there = -1
        self.plug_in()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def plug_in(self) -> None:
        with self._lock:
            self._here, self._there = os.openpty()
            tty.setraw(self._there)
            os.set_blocking(self._here, False)
            self.name.symlink_to(os.ttyname(self._there))

    def pull_out(self) -> None:
        with self._lock:
            self.name.unlink()
            os.close(self._there)
            os.close(self._here)
            self._here = -1

    def _serve(self) -> None:
        while not self._end.is_set():
            with self._lock:
                self._carry()
            select.select([self._vehicle], [], [], 0.005)

    def _carry(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                data = self._vehicle.recv(2048)
                if self._here >= 0:
                    os.write(self._here, data)
        with contextlib.suppress(OSError):
            if self._here >= 0:
                self._vehicle.send(os.read(self._here, 1024))

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.pull_out()
        self._vehicle.close()


@contextlib.contextmanager
def cabled(folder: Path) -> Iterator[tuple[Path, list[Cable]]]:
    """The mission, whose vehicles are simulated behind serial ports, and their cables."""
    ports = free_ports(2, socket.SOCK_DGRAM)
    names = [DEVICES / f"swarm-ctl-{os.getpid()}-{i}" for i in (1, 2)]  # a fleet names /dev/...
    one, two = (f"{{id: {i}, endpoint: 'serial:{name}:57600'" for i, name in enumerate(names, 1))
    mission = folder / "cabled.yaml"
    agents = f"    - {one}}}\n    - {two}, autopilot: px4}}\n"
    mission.write_text(f"{MISSION}\nfleet:\n  agents:\n{agents}")
    simulated = folder / "simulated.yaml"
    ends = "    - {id: 1}\n    - {id: 2, autopilot: px4}\n"
    simulated.write_text(f"{MISSION}\nfleet:\n  agents:\n{ends}")
    where = [text for port in ports for text in ("--endpoint", f"udpin:127.0.0.1:{port}")]
    vehicles = subprocess.Popen(
        [SWARM_CTL, "sim", "--mission", simulated, *where], stdout=subprocess.DEVNULL, cwd=folder
    )
    try:
        with contextlib.ExitStack() as stack:
            pairs = zip(names, ports, strict=True)
            cables = [stack.enter_context(contextlib.closing(Cable(n, p))) for n, p in pairs]
            yield mission, cables
    finally:
        vehicles.terminate()
        vehicles.wait(10)


@pytest.mark.long
def test_half_a_second_without_the_plugs_ends_no_flight(tmp_path: Path) -> None:
    """A port was never opened again, and the whole swarm landed. A PX4 without setpoints for 1 s
    leaves OFFBOARD for good; the port is open again before."""
    pytest.importorskip("serial", reason="pyserial is not installed")
    if not DEVICES.is_dir():
        pytest.skip("names of devices are made in /dev/shm, which this system does not have")
    with (
        cabled(tmp_path) as (mission, cables),
        Running("run", mission, "--headless", "--no-report", cwd=tmp_path) as running,
    ):
        running.wait_for(lambda: "step 3/4" in running.output, 90)
        time.sleep(1.0)
        for cable in cables:
            cable.pull_out()
        time.sleep(GAP_S)
        for cable in cables:
            cable.plug_in()
        assert running.wait(90) == 0, running.output
        for cable in cables:
            assert f"serial port {cable.name} is gone" in running.output.replace("\n", "")
        running.assert_nothing_left()
