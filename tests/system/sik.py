"""A telemetry radio of 57,600 baud at a pseudo-terminal, with simulated vehicles behind it.

By hand: `python -m tests.system.sik MISSION [BYTES_PER_S]` prints the device to name in the fleet.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

from swarm_ctl.engine.launch.ports import free_ports
from tests.scenarios.radio import Channel
from tests.system.running import SWARM_CTL

_STEP_WALL_S = 0.005


class Sik:
    """One end of the pseudo-terminal, and a UDP socket for each vehicle."""

    def __init__(self, ports: list[int], bytes_per_s: float) -> None:
        self._here, self._there = os.openpty()
        tty.setraw(self._there)
        os.set_blocking(self._here, False)
        self.device = os.ttyname(self._there)
        self._vehicles = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in ports]
        for vehicle, port in zip(self._vehicles, ports, strict=True):
            vehicle.connect(("127.0.0.1", port))
            vehicle.setblocking(False)
        self._channel = Channel(bytes_per_s, len(ports) + 1)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._end.is_set():
            with contextlib.suppress(OSError):
                self._channel.send(0, os.read(self._here, 1024))
            for place, vehicle in enumerate(self._vehicles, start=1):
                with contextlib.suppress(OSError):
                    while True:
                        self._channel.send(place, vehicle.recv(2048))
            for sender, data in self._channel.step(time.monotonic()):
                self._deliver(sender, data)
            select.select([self._here], [], [], _STEP_WALL_S)

    def _deliver(self, sender: int, data: bytes) -> None:
        with contextlib.suppress(OSError):
            if sender:
                os.write(self._here, data)
            for vehicle in () if sender else self._vehicles:
                vehicle.send(data)

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        for vehicle in self._vehicles:
            vehicle.close()
        os.close(self._here)
        os.close(self._there)


@contextlib.contextmanager
def radio(
    mission: Path, count: int, bytes_per_s: float = 5760, *, truth: str = os.devnull
) -> Iterator[str]:
    """The device of a radio with the mission's vehicles, which are simulated, behind it.

    `truth`: the file with their true positions.
    """
    ports = free_ports(count, socket.SOCK_DGRAM)
    ends = [text for port in ports for text in ("--endpoint", f"udpin:127.0.0.1:{port}")]
    vehicles = subprocess.Popen(
        [SWARM_CTL, "sim", "--mission", mission, "--truth", truth, *ends], stdout=subprocess.DEVNULL
    )
    try:
        with contextlib.closing(Sik(ports, bytes_per_s)) as sik:
            yield sik.device
    finally:
        vehicles.terminate()
        vehicles.wait(10)


if __name__ == "__main__":
    with radio(Path(sys.argv[1]), 3, *map(float, sys.argv[2:])) as device:
        print(device, flush=True)
        threading.Event().wait()
