"""What simulated vehicles cost: `python -m tests.bench.bench_sim [--quick]`.

Load per vehicle and mission second: LOCAL_POSITION_NED 20, ATTITUDE 10, GLOBAL_POSITION_INT 5,
HEARTBEAT 1 out, velocity setpoints 20 in, all in flight. The client only sends: what the kernel has
no room for is dropped.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console
from rich.table import Table

from swarm_sim.firmware.message import Message
from swarm_sim.network.codec import Codec
from swarm_sim.network.hub import Hub
from swarm_sim.physics.response import ArdupilotResponse
from swarm_sim.world.world import STEP_S, VehicleGroup
from tests.unit.sim.harness import config

SIZES = (1, 6, 32, 100, 500)
SPEEDUPS = (1, 2, 5, 7, 10, 15, 20, 30, 50, 75, 100, 150, 200)
ASKED = {1: 50, 6: 50, 32: 15, 100: 5, 500: 1}
"""The speed-ups that are asked of one core."""
CLIENT = ("127.0.0.1", 9)
STREAMS = ((32, 20.0), (30, 10.0), (33, 5.0))
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
BASE_PORT = 18000
MOST = 250
_mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


def _command(place: int, command: int, *p: float) -> bytes:
    numbers = [*p, *[0.0] * (7 - len(p))]
    return bytes(
        mavlink.MAVLink_command_long_message(place % 250 + 1, 1, command, 0, *numbers).pack(_mav)
    )


def _setpoint(place: int) -> bytes:
    zeros = (0.0,) * 5
    target = (place % 250 + 1, 1)
    m = mavlink.MAVLink_set_position_target_local_ned_message(
        0, *target, 1, 3527, 0, 0, 0, 1.0, 0.5, 0.0, *zeros
    )
    return bytes(m.pack(_mav))


def _start(place: int) -> list[bytes]:
    streams = [_command(place, 511, number, 1e6 / rate) for number, rate in STREAMS]
    return [
        *streams,
        _command(place, 176, 1, 4),
        _command(place, 400, 1),
        _command(place, 22, 0, 0, 0, 0, 0, 0, 10),
    ]


def physics(n: int) -> float:
    """Steps of `n` vehicles a second of CPU."""
    group = VehicleGroup(ArdupilotResponse(), np.zeros((n, 3)), np.zeros(n))
    group.state.landed[:] = False
    group.state.ground[:] = 1e6
    group.demands.lift[:] = True
    count = max(200, 20_000 // n)
    rng = np.random.default_rng(1)
    targets = rng.normal(0.0, 1.0, (20, n, 3))
    start = time.process_time()
    for k in range(count):
        if k % 2 == 0:
            group.demands.velocity = targets[k // 2 % 20]
        group.step(STEP_S)
    return count / (time.process_time() - start)


def frames() -> tuple[float, float]:
    """Frames packed, and parsed, a second of CPU; LOCAL_POSITION_NED and setpoints."""
    codec = Codec(1)
    fields = {"time_boot_ms": 1, "x": 1.0, "y": 2.0, "z": 3.0, "vx": 0.1, "vy": 0.2, "vz": 0.3}
    start = time.process_time()
    for _ in range(50_000):
        codec.pack(Message("LOCAL_POSITION_NED", fields))
    packed = 50_000 / (time.process_time() - start)
    data = _setpoint(0)
    start = time.process_time()
    for _ in range(50_000):
        list(codec.messages(data))
    return packed, 50_000 / (time.process_time() - start)


def inside(n: int) -> dict[str, float]:
    """Microseconds per vehicle-second without sockets, by part."""
    hub = Hub(config(n), 0.0, lambda *_: None)
    for place in range(n):
        for frame in _start(place):
            hub.receive(place, frame, CLIENT)
    for _ in range(round(8.0 / STEP_S)):
        hub.step()
    if not all(hub.world.airborne()):
        raise RuntimeError("not all vehicles took off")
    setpoints = [_setpoint(place) for place in range(n)]
    spent = {"setpoints in": 0.0, "steps, firmware, frames out": 0.0}
    seconds = max(3, 60 // n)
    clock = time.process_time
    due = hub.world.time_s
    for _ in range(round(seconds / STEP_S)):
        if hub.world.time_s >= due:
            due += 0.05
            start = clock()
            for place in range(n):
                hub.receive(place, setpoints[place], CLIENT)
            spent["setpoints in"] += clock() - start
        start = clock()
        hub.step()
        spent["steps, firmware, frames out"] += clock() - start
    spent["of them physics"] = seconds / STEP_S / physics(n)
    return {name: 1e6 * value / n / seconds for name, value in spent.items()}


@contextlib.contextmanager
def process(
    n: int, speedup: float, epoch_s: float, folder: Path, first: int
) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A simulator of `n` vehicles, the first of them at place `first`."""
    settings = config(n).model_dump(mode="json")
    truth = folder / f"truth{first}.jsonl"
    settings |= {"speedup": speedup, "epoch_s": epoch_s, "truth_path": str(truth)}
    for place, vehicle in enumerate(settings["vehicles"]):
        vehicle["endpoint"] = f"udpin:127.0.0.1:{BASE_PORT + first + place}"
    path = folder / f"sim{first}.json"
    path.write_text(json.dumps(settings))
    command = [sys.executable, "-m", "swarm_sim", "--config", str(path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as running:
        try:
            assert running.stdout is not None
            if not running.stdout.readline():
                raise RuntimeError(
                    f"the simulator did not start; is a port from {BASE_PORT} on busy?"
                )
            yield running, truth
        finally:
            running.kill()


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def _last_state(truth: Path) -> str:
    """The last that is written whole: the simulator is still writing."""
    whole = truth.read_text().rpartition("\n")[0]
    return [line for line in whole.split("\n") if line.startswith('{"type":"state"')][-1]


def served(n: int, speedup: float, seconds: float) -> dict[str, Any]:
    """Flies `n` vehicles in processes of their own: CPU per vehicle-second, and how far they fell
    behind the clock.

    System ids end at 250, so more vehicles take more than one process.
    """
    epoch_s = time.monotonic()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        client = stack.enter_context(
            contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        )
        parts = [(first, min(MOST, n - first)) for first in range(0, n, MOST)]
        started = [
            stack.enter_context(process(m, speedup, epoch_s, folder, first)) for first, m in parts
        ]
        addresses = [("127.0.0.1", BASE_PORT + place) for place in range(n)]

        def now() -> float:
            return (time.monotonic() - epoch_s) * speedup

        time.sleep(0.3)
        for place, address in enumerate(addresses):
            for frame in _start(place):
                client.sendto(frame, address)
        time.sleep(8.0 / speedup + 0.5)
        setpoints = [_setpoint(place) for place in range(n)]
        start, cpu = now(), sum(_cpu_s(running.pid) for running, _ in started)
        sent, due = 0, start
        while now() < start + seconds * speedup:
            for frame, address in zip(setpoints, addresses, strict=True):
                client.sendto(frame, address)
            sent += 1
            due += 0.05
            time.sleep(max(0.0, (due - now()) / speedup))
        end, used = now(), sum(_cpu_s(running.pid) for running, _ in started) - cpu
        last = [json.loads(_last_state(truth)) for _, truth in started]
    return {
        "us": 1e6 * used / n / (end - start),
        "cores": used * speedup / (end - start),
        "behind_s": end - min(state["t"] for state in last),
        "rate_hz": sent / (end - start),
        "airborne": sum(sum(state["airborne"]) for state in last),
    }


def greatest(n: int, seconds: float) -> tuple[int, dict[str, Any]]:
    """The greatest speed-up of `SPEEDUPS` held, with what it cost."""
    best, figures = 0, {"us": float("nan"), "cores": float("nan")}
    for speedup in SPEEDUPS:
        found = served(n, speedup, seconds)
        held = (
            found["behind_s"] < 0.2 + 0.02 * speedup
            and found["airborne"] == n
            and found["rate_hz"] > 18
        )
        if not held:
            break
        best, figures = speedup, found
    return best, figures


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--quick",
        action="store_true",
        help="each at the speed-up asked of it, without the search for the greatest",
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    arguments = parser.parse_args()
    console = Console()
    console.print(f"load before: {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores")
    packed, parsed = frames()
    console.print(f"frames a CPU second: {packed:,.0f} packed, {parsed:,.0f} parsed")
    table = Table(
        "vehicles",
        "physics steps/s",
        "us per vehicle-second, no sockets",
        "physics",
        "setpoints in",
    )
    for n in [n for n in arguments.sizes if n <= MOST]:
        parts = inside(n)
        total = parts["setpoints in"] + parts["steps, firmware, frames out"]
        physical, setpoints = parts["of them physics"], parts["setpoints in"]
        table.add_row(
            str(n), f"{physics(n):,.0f}", f"{total:.0f}", f"{physical:.0f}", f"{setpoints:.0f}"
        )
    console.print(table)
    table = Table("vehicles", "speed-up", "us CPU per vehicle-second, process", "cores", "behind s")
    for n in arguments.sizes:
        speedup, found = (
            (ASKED[n], served(n, ASKED[n], 4.0)) if arguments.quick else greatest(n, 4.0)
        )
        row = (
            f"{found['us']:.0f}",
            f"{found['cores']:.2f}",
            f"{found.get('behind_s', float('nan')):.2f}",
        )
        table.add_row(str(n), str(speedup), *row)
    console.print(table)
    console.print(f"load after: {os.getloadavg()[0]:.2f}")


if __name__ == "__main__":
    main()
