"""What one tick of a vehicle link costs: `python -m tests.bench.bench_link` (microseconds, one
core, no sockets).

A tick at 20 Hz receives what a vehicle with six others in sight streams: LOCAL_POSITION_NED each
tick, the rest in turn (about 70 messages/s), then takes the view and sends a setpoint.
"""

from __future__ import annotations

import statistics
import time

from pymavlink.dialects.v20 import common

from swarm_ctl.core.model.vehicle import FlyGoal, StandbyGoal
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.mavlink import wire

TICKS = 4000
TICK_S = 0.05
KEY, START = bytes(range(32)), 10**12


def traffic(tick: int) -> list[common.MAVLink_message]:
    """The messages of one tick of a real stream: 20 + 5 + 2 + 2 + 1 + 40 a second."""
    messages = [wire.local_position(boot_ms=tick * 50)]
    messages += [wire.traffic(address) for address in range(2, 4)]
    if tick % 4 == 0:
        messages.append(wire.global_position(boot_ms=tick * 50))
    if tick % 10 == 0:
        messages += [wire.system_status(), wire.extended_state(1)]
    if tick % 20 == 0:
        messages.append(wire.heartbeat(custom_mode=4, armed=True))
    return messages


def main() -> None:
    """Print the median and the 99th percentile per part, of an open link and of a signed one."""
    for is_signed in (False, True):
        print("signed" if is_signed else "open")
        measure(is_signed=is_signed)


def measure(*, is_signed: bool) -> None:
    """One link, from its first frame on."""
    ours, theirs = memory_wires()
    vehicle = wire.Vehicle(theirs, sysid=1)
    if is_signed:
        own = vehicle.codec.signing
        own.secret_key, own.sign_outgoing, own.timestamp = KEY, True, START
    link = VehicleLink(ours, "ardupilot", 1, signing=LinkSigning(KEY, START) if is_signed else None)
    parts: dict[str, list[float]] = {"receive": [], "view": [], "pursue": [], "all": []}
    vehicle.say(wire.heartbeat(custom_mode=4, armed=True))
    link.receive(0.0)
    link.pursue(StandbyGoal(), 0.0)
    count = 0
    for tick in range(1, TICKS):
        now = tick * TICK_S
        messages = traffic(tick)
        count += len(messages)
        vehicle.say(*messages)
        marks = [time.perf_counter()]
        link.receive(now)
        marks.append(time.perf_counter())
        link.view()
        marks.append(time.perf_counter())
        link.pursue(FlyGoal((1.0, 0.5, 0.0)), now)
        marks.append(time.perf_counter())
        for name, start, end in zip(("receive", "view", "pursue"), marks, marks[1:], strict=False):
            parts[name].append((end - start) * 1e6)
        parts["all"].append((marks[-1] - marks[0]) * 1e6)
        while theirs.read():
            pass
    print(
        f"{count / (TICKS * TICK_S):.0f} messages/s in, {1 / TICK_S:.0f} setpoints/s out; "
        "us per tick"
    )
    for name, values in parts.items():
        print(
            f"{name:8} p50 {statistics.median(values):6.1f}  "
            f"p99 {statistics.quantiles(values, n=100)[98]:6.1f}"
        )
    link.close()


if __name__ == "__main__":
    main()
