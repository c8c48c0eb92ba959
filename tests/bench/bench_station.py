"""What a station costs: 32 made-up agents at 20 Hz over zenoh, the dashboard on a terminal,
everything recorded.

    python -m tests.bench.bench_station [--agents 32] [--seconds 20] [--show dashboard] [--screen
    swarm] [--slow]

`--slow` reads the terminal at 2 kB/s: the station must go on listening, and say how many pictures
it skipped.
"""

from __future__ import annotations

import argparse
import fcntl
import math
import os
import pty
import select
import signal
import socket
import struct
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.model.messages import LinkReport, SigmaReport
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.launch_file import Launch, write_launch
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.runfolder.manifest import Manifest, write_manifest
from tests.unit.station.swarm import hexagon_plan, report_of, state_of, status_of

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
KEYS = {"swarm": b"1", "links": b"2", "sigma": b"3", "log": b"4"}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--agents", type=int, default=32)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--show", default="dashboard")
    parser.add_argument("--screen", choices=KEYS, default="swarm")
    parser.add_argument("--size", default="160x50")
    parser.add_argument("--slow", action="store_true")
    arguments = parser.parse_args()
    plan = hexagon_plan(arguments.agents)
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        epoch = time.monotonic()
        ports = [f"tcp/127.0.0.1:{port}" for port in free_ports(2, socket.SOCK_STREAM)]
        swarm = Swarm(plan, epoch, ports[0])
        write_manifest(folder, _manifest(plan, epoch, ports))
        (folder / "agents").mkdir()
        pid, terminal, control = _station(folder, arguments.show, arguments.size)
        try:
            _measure(arguments, swarm, pid, terminal, folder, load)
        finally:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            os.close(control)
            swarm.close()


def _measure(
    arguments: argparse.Namespace, swarm: Swarm, pid: int, terminal: int, folder: Path, load: float
) -> None:
    reader = Reader(terminal, 2000 if arguments.slow else None)
    time.sleep(4.0)
    os.write(terminal, KEYS[arguments.screen])
    time.sleep(1.0)
    cpu, drawn, sent, start = _cpu_s(pid), reader.total, swarm.sent, time.monotonic()
    recorded = _recorded(folder)
    time.sleep(arguments.seconds)
    took = time.monotonic() - start
    share = 100 * (_cpu_s(pid) - cpu) / took
    recorded = _recorded(folder) - recorded
    print(
        f"{arguments.agents} agents, {(swarm.sent - sent) / took:.0f} messages/s, "
        f"{arguments.show} {arguments.screen} {arguments.size}: {share:.1f} % of a core, "
        f"{(reader.total - drawn) / took / 1000:.1f} kB/s to the terminal, "
        f"{60 * recorded / took / 1e6:.1f} MB a minute recorded; "
        f"load before {load:.1f}, now {os.getloadavg()[0]:.1f}"
    )
    tail = reader.tail.decode(errors="replace")
    if "frames skipped" in tail:
        print(
            "the title says:", tail[: tail.rindex("frames skipped")][-12:].strip(), "frames skipped"
        )
    reader.stop()


def _recorded(folder: Path) -> int:
    files = (*folder.glob("*.jsonl"), *folder.glob("*.mcap"))
    return sum(path.stat().st_size for path in files)


class Swarm:
    """Publishes what `count` agents would, from one thread."""

    def __init__(self, plan: Plan, epoch_s: float, endpoint: str) -> None:
        self._plan = plan
        self._epoch = epoch_s
        self._transport = ZenohTransport([endpoint], [], self._now)
        self._nodes = {
            agent.id: Node(self._transport, plan.name, agent.id) for agent in plan.agents
        }
        self.sent = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _now(self) -> float:
        return time.monotonic() - self._epoch

    def _run(self) -> None:
        tick = 0
        while not self._stop.wait(max(0.0, self._epoch + tick * 0.05 - time.monotonic())):
            for agent, node in self._nodes.items():
                self._speak(agent, node, tick)
            tick += 1

    def _speak(self, agent: int, node: Node, tick: int) -> None:
        now, angle = self._now(), 0.01 * tick + agent
        radius = 40.0 + 5 * agent
        place = (radius * math.cos(angle), radius * math.sin(angle), -10.0 + 0.01 * (tick % 50))
        node.send(keys.STATE, state_of(self._plan, agent, now, seq=tick, position_ned_m=place))
        self.sent += 1
        if (tick + agent) % 4 == 0:
            pairs = tuple(
                report_of(agent % len(self._nodes) + 1, 1.3, sigma=0.4 + 0.001 * (tick % 90))
                for _ in (1,)
            )
            node.send(keys.SIGMA, SigmaReport(agent, now, (0.001, 0.0), (0.0, 0.002), pairs))
            self.sent += 1
        if (tick + agent) % 10 == 0:
            status = status_of(self._plan, agent, now, battery_percent=50.0 + tick % 40)
            links = status.links if hears_all(self._plan) else _near(status.links, agent)
            node.send(keys.STATUS, replace(status, station_age_s=0.1, links=links))
            self.sent += 1

    def close(self) -> None:
        """Fall silent."""
        self._stop.set()
        self._thread.join()
        self._transport.close()


def _near(links: Mapping[int, LinkReport], agent: int) -> dict[int, LinkReport]:
    """Those of a dozen peers, as an agent of a large swarm has them."""
    return {peer: link for peer, link in links.items() if abs(peer - agent) <= 6}


class Reader:
    """Reads a terminal away, at most `rate` bytes a second."""

    def __init__(self, terminal: int, rate: int | None) -> None:
        self.total = 0
        self.tail = b""
        self._terminal = terminal
        self._rate = rate
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            if not select.select([self._terminal], [], [], 0.1)[0]:
                continue
            data = os.read(self._terminal, 65536 if self._rate is None else self._rate // 10)
            self.total += len(data)
            self.tail = (self.tail + data)[-200_000:]
            if self._rate is not None:
                self._stop.wait(0.1)

    def stop(self) -> None:
        """No more."""
        self._stop.set()
        self._thread.join()


def _station(folder: Path, show: str, size: str) -> tuple[int, int, int]:
    """Start it on a terminal of its own; (pid, our end of the terminal, our end of its control
    pipe)."""
    read, write = os.pipe()
    words = os.open(folder / "words", os.O_WRONLY | os.O_CREAT)
    os.set_inheritable(words, True)
    pid, terminal = pty.fork()
    if pid == 0:
        os.dup2(read, 0)
        os.dup2(os.open(folder / "station.log", os.O_WRONLY | os.O_CREAT), 2)
        os.environ["TERM"] = "xterm-256color"
        os.environ["COLORTERM"] = "truecolor"
        write_launch(folder, Launch(show))
        command = [sys.executable, "-m", "swarm_ctl.engine.station.station_process", str(folder)]
        os.execv(sys.executable, [*command, str(words)])  # noqa: S606 - ourselves
    os.close(read)
    os.close(words)
    columns, _, rows = size.partition("x")
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", int(rows), int(columns), 0, 0))
    return pid, terminal, write


def _manifest(plan: Plan, epoch_s: float, ports: list[str]) -> Manifest:
    return Manifest(
        mission="made up",
        swarm=plan.name,
        started_at=datetime.now(UTC),
        speedup=1.0,
        epoch_s=epoch_s,
        headless=False,
        plan=plan,
        plan_hash=plan.fingerprint(),
        fleet=tuple(
            FleetAgent(agent.id, agent.id, "ardupilot", mesh=ports[0]) for agent in plan.agents
        ),
        station_mesh=ports[1],
    )


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


if __name__ == "__main__":
    main()
