"""The simulator as a process of its own, and a pilot that speaks pymavlink to one of its
vehicles."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.engine.launch.ports import free_ports

ORIGIN = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_m": 488.0}
SPEEDUP = 5.0
"""Quick, and still a pilot process not scheduled for 0.1 s misses no time-out of the autopilots."""
PATIENCE_S = 60.0
"""Mission seconds anything asked for may take; a vehicle that needs longer is broken."""


def free_port() -> int:
    """A UDP port that no caller had before, below the ephemeral ones, which any socket may get."""
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    return port


def settings(tmp_path: Path, persona: str, n: int = 1) -> dict[str, Any]:
    """`n` vehicles, 5.56 m apart to the north."""
    vehicles = [
        {
            "sysid": i + 1,
            "persona": persona,
            "endpoint": f"udpin:127.0.0.1:{free_port()}",
            "also": [f"udpin:127.0.0.1:{free_port()}"],
            "lat_deg": ORIGIN["lat_deg"] + 5e-5 * i,
            "lon_deg": ORIGIN["lon_deg"],
            "alt_m": ORIGIN["alt_m"],
            "ready_after_s": 2.0,
        }
        for i in range(n)
    ]
    timing = {"speedup": SPEEDUP, "epoch_s": time.monotonic()}
    truth = {"truth_path": str(tmp_path / "truth.jsonl")}
    return {"version": 1, "seed": 3, "origin": ORIGIN, "vehicles": vehicles} | timing | truth


def command_line(tmp_path: Path, configuration: dict[str, Any]) -> list[str]:
    """Writes the configuration; what to run."""
    path = tmp_path / "sim.json"
    path.write_text(json.dumps(configuration))
    return [sys.executable, "-m", "swarm_sim", "--config", str(path)]


class Simulator:
    """A running one. `process.stdin` is its lifeline."""

    def __init__(self, configuration: dict[str, Any], process: subprocess.Popen[str]) -> None:
        self.configuration = configuration
        self.process = process
        self.ready = json.loads(_pipe(process.stdout).readline())

    def now(self) -> float:
        """Mission time."""
        return float(
            (time.monotonic() - self.configuration["epoch_s"]) * self.configuration["speedup"]
        )

    def endpoint(self, place: int = 0, *, further: bool = False) -> str:
        """Where a client connects to; the further endpoint is a link of its own."""
        vehicle = self.configuration["vehicles"][place]
        endpoint = vehicle["also"][0] if further else vehicle["endpoint"]
        return str(endpoint).replace("udpin", "udpout")

    def cut_lifeline(self) -> None:
        """What its parent's death does."""
        _pipe(self.process.stdin).close()

    def end(self) -> int:
        """The exit code, when it has ended by itself."""
        return self.process.wait(timeout=60)

    def truth(self) -> list[dict[str, Any]]:
        """The truth file's lines; the last may be cut off only by a kill, and then isn't there."""
        lines = Path(self.configuration["truth_path"]).read_text().splitlines()
        return [json.loads(line) for line in lines]


@contextlib.contextmanager
def simulator(tmp_path: Path, configuration: dict[str, Any]) -> Iterator[Simulator]:
    """Starts one, waits until it is ready, and leaves nothing behind."""
    arguments = command_line(tmp_path, configuration)
    with subprocess.Popen(
        arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield Simulator(configuration, process)
        finally:
            process.kill()


def wait_until(sim: Simulator, what: str, met: Callable[[], Any]) -> None:
    """Until `met`, looked at often, within `PATIENCE_S` of mission time; for clients that have no
    wait of their own."""
    end = sim.now() + PATIENCE_S
    while not met():
        if sim.now() > end:
            raise TimeoutError(f"no {what} within {PATIENCE_S} s")
        time.sleep(0.02)


class Pilot:
    """A ground station with one vehicle. Every wait is bounded, in mission time."""

    def __init__(
        self, sim: Simulator, place: int = 0, system: int = 255, *, further: bool = False
    ) -> None:
        self.sim = sim
        self.sysid = sim.configuration["vehicles"][place]["sysid"]
        self._link = mavutil.mavlink_connection(
            sim.endpoint(place, further=further),
            source_system=system,
            source_component=190,
            dialect="ardupilotmega",
        )
        self.mav = self._link.mav
        self._heartbeat_s = -1.0
        self.texts: list[str] = []
        self.latest: dict[str, Any] = {}

    def close(self) -> None:
        """Frees the socket."""
        self._link.close()

    def wait(self, what: str, until: Callable[[Any], bool] = lambda _: True) -> Any:
        """The next message named `what` for which `until` holds."""
        end = self.sim.now() + PATIENCE_S
        while (now := self.sim.now()) < end:
            if now - self._heartbeat_s >= 1.0:
                self._heartbeat_s = now
                self.mav.heartbeat_send(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0
                )
            message = self._link.recv_match(blocking=True, timeout=0.002)
            if message is None:
                continue
            self._note(message)
            if message.get_type() == what and until(message):
                return message
        raise TimeoutError(f"no {what} within {PATIENCE_S} s; texts: {self.texts}")

    def _note(self, message: Any) -> None:
        self.latest[message.get_type()] = message
        if message.get_type() == "STATUSTEXT":
            self.texts.append(message.text)

    def command(self, command: int, *p: float) -> int:
        """COMMAND_LONG; its result."""
        numbers = [*p, *[0.0] * (7 - len(p))]
        self.mav.command_long_send(self.sysid, 1, command, 0, *numbers)
        return int(self.wait("COMMAND_ACK", lambda m: m.command == command).result)

    def stream(self, message_id: int, rate_hz: float) -> None:
        """SET_MESSAGE_INTERVAL."""
        assert self.command(511, message_id, 1e6 / rate_hz) == 0


@contextlib.contextmanager
def pilot(
    sim: Simulator, place: int = 0, system: int = 255, *, further: bool = False
) -> Iterator[Pilot]:
    """A connected one."""
    found = Pilot(sim, place, system, further=further)
    try:
        found.wait("HEARTBEAT")
        yield found
    finally:
        found.close()


def _pipe(pipe: IO[str] | None) -> IO[str]:
    if pipe is None:
        raise ValueError("started without this pipe")
    return pipe
