"""What keys cost, beside an open mesh in one run: CPU and memory of an agent, start, latency of a
message.

    python -m tests.bench.bench_trust [--mission missions/hexagon.yaml] [--seconds 20]

Three flights go side by side in real time: with an open mesh, with TLS, and with TLS and signed
links. Then two links between two processes carry messages in turn: one is TCP, one TLS.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import socket
import statistics
import struct
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh.access import access_settings
from swarm_ctl.mesh.keys import CLOCK
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.trust.identity import load_identity
from swarm_ctl.trust.provision import Terms, new
from tests.bench.bench_run import ROOT, Usage, _fly

_FLEETS: Final = {
    "open": "",
    "TLS": "trust: {trust}\nsigning: off\n",
    "TLS, signed links": "trust: {trust}\n",
}
_RATE_HZ: Final = 100.0
"""What an agent hears of five others."""
_STAMP: Final = struct.Struct("<d")
_SWARM: Final = "bench"


def main() -> None:
    """Fly, measure, and print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--mission", type=Path, default=ROOT / "missions" / "hexagon.yaml")
    parser.add_argument("--seconds", type=float, default=20.0)
    arguments = parser.parse_args()
    console = Console()
    agents = [agent.id for agent in load(arguments.mission).plan.agents]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        new(
            folder / "trust",
            "field",
            dict.fromkeys(agents, "127.0.0.1"),
            ["anna"],
            [],
            Terms(datetime.now(UTC)),
        )
        console.print(_latencies(folder / "trust", arguments.seconds))
        load_before = os.getloadavg()
        console.print(_flights(arguments.mission, folder, agents))
    after = os.getloadavg()
    console.print(f"load before {load_before[0]:.2f}, after {after[0]:.2f}, {os.cpu_count()} cores")


def _flights(mission: Path, folder: Path, agents: list[int]) -> Table:
    flights = {}
    for name, head in _FLEETS.items():
        where = folder / name
        where.mkdir()
        entries = "".join(f"  - {{id: {i}}}\n" for i in agents)
        fleet = where / "fleet.yaml"
        fleet.write_text(f"{head.format(trust=folder / 'trust')}agents:\n{entries}")
        flights[name] = where, ("--fleet", str(fleet), "--no-report")
    with ThreadPoolExecutor(len(flights)) as pool:
        flown = {
            name: pool.submit(_fly, mission, 1.0, where, more)
            for name, (where, more) in flights.items()
        }
    table = Table("mesh", "outcome", "ready s", "agent CPU %", "private MiB", "station CPU %")
    for name, future in flown.items():
        summary, usages, _, ready_s = future.result()
        crew = [usage for who, usage in usages.items() if who.startswith("agent-")]
        table.add_row(
            name,
            str(summary["outcome"]),
            f"{ready_s:.2f}",
            f"{statistics.mean(map(_share, crew)):.2f}",
            f"{statistics.mean(usage.private_mib for usage in crew):.1f}",
            f"{_share(usages['station']):.2f}",
        )
    return table


def _share(usage: Usage) -> float:
    return 100 * usage.cpu_s / max(usage.watched_s, 1e-9)


def _latencies(trust: Path, seconds: float) -> Table:
    """From `publish` in one process to the callback in another, both links in turn."""
    ports = free_ports(2, socket.SOCK_STREAM)
    links = dict(zip(("TCP", "TLS"), ports, strict=True))
    sender = multiprocessing.get_context("spawn").Process(
        target=_send, args=(trust, links, seconds), daemon=True
    )
    taken: dict[str, list[float]] = {name: [] for name in links}
    here = dict(_joined(trust / "agent-1", links, listens=True))
    inlets = {
        name: node.subscribe(CLOCK.key_expression(_SWARM), timed=True)
        for name, node in here.items()
    }
    sender.start()
    while sender.is_alive():
        time.sleep(0.05)
        for name, inlet in inlets.items():
            for received_s, _, data in inlet.drain():
                taken[name].append(1000 * (received_s - _STAMP.unpack_from(bytes(data))[0]))
    for node in here.values():
        node.close()
    table = Table("link", "messages", "p50 ms", "p99 ms")
    for name, found in taken.items():
        parts = statistics.quantiles(found, n=100)
        table.add_row(name, str(len(found)), f"{parts[49]:.3f}", f"{parts[98]:.3f}")
    return table


def _joined(
    folder: Path, links: Mapping[str, int], *, listens: bool
) -> Iterator[tuple[str, ZenohTransport]]:
    access: Mapping[str, Any] = access_settings(load_identity(folder), _SWARM)
    for name, port in links.items():
        at = [f"tcp/127.0.0.1:{port}"]
        ends = (at, []) if listens else ([], at)
        yield name, ZenohTransport(*ends, time.monotonic, access=access if name == "TLS" else None)


def _send(trust: Path, links: Mapping[str, int], seconds: float) -> None:
    nodes = dict(_joined(trust / "agent-2", links, listens=False))
    time.sleep(1.0)
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        for node in nodes.values():
            stamp = _STAMP.pack(time.monotonic())
            node.publish(CLOCK.key(_SWARM, 2), stamp.ljust(100, b"."), CLOCK.qos)
            time.sleep(1 / _RATE_HZ / len(nodes))
    for node in nodes.values():
        with closing(node):
            pass


if __name__ == "__main__":
    main()
