"""How a run grows with its agents: real processes, headless, in real time, formed up and hovering.

    python -m tests.bench.bench_scale [--agents 6,16,32,64,100] [--seconds 30] [--lockstep 250]

Each size flies up, forms a block and holds it. Its processes are looked at over `--seconds` from
the moment when all agents are airborne; then the run lands by Ctrl-C. Lateness and ages are those
of the whole flight, by the agents' last words, and the loopback counters have all of the host's
traffic, the links to the vehicles too. The last column has the exponent of growth: a fit of log y
over log n. `--lockstep N` flies one mission of N agents to its end instead.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from tests.bench.bench_run import Usage, _all_airborne, _look
from tests.system.running import SWARM_CTL

_TICKS_HZ = 20.0
_HOLD_S = 600
_UP_WALL_S, _END_WALL_S = 120.0, 120.0


def mission_text(count: int, hold_s: float) -> str:
    """`count` agents in rows 23 m apart form a block of 12 m, as `missions/hundred.yaml`."""
    columns = math.isqrt(count - 1) + 1
    agents = "\n".join(
        f"  - {{id: {k + 1}, start: [{23 * (k // columns)}, {23 * (k % columns)}]}}"
        for k in range(count)
    )
    return f"""version: 1
name: scale-{count}
origin: {{lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}}
lengths: metres
law: {{r: 32, r_out: 6, r_in: 2.5}}
vehicle: {{limits: {{speed_mps: 2.5}}}}
agents:
{agents}
shapes:
  block: {{kind: grid, spacing: 12}}
steps:
  - takeoff: {{height_m: 10}}
  - form: {{shape: block, timeout_s: 300}}
  - hold: {{duration_s: {hold_s:g}}}
  - land
"""


@dataclass
class Flight:
    """What one size came to."""

    count: int
    ready_s: float = math.nan
    watched_s: float = math.nan
    cpu_s: dict[str, float] = field(default_factory=dict)
    """By kind of process, over the time watched."""
    private_mib: dict[str, float] = field(default_factory=dict)
    """Of all processes of a kind, at the end of that time."""
    packets: float = math.nan
    """Over loopback, a second."""
    bytes: float = math.nan
    heard: float = math.nan
    """States that an agent heard, a second."""
    late_p99_ms: tuple[float, float] = (math.nan, math.nan)
    """Of the median agent and the worst."""
    overruns: float = math.nan
    """Share of the ticks."""
    age_p99_ms: float = math.nan
    """Of the states of a peer that was heard at every tick, of the median link."""
    outcome: str = ""

    def share(self, kind: str) -> float:
        """Of a core [%]."""
        return 100 * self.cpu_s.get(kind, 0.0) / self.watched_s

    @property
    def tick_ms(self) -> float:
        """CPU of an agent's process in a tick."""
        return 1000 * self.cpu_s.get("agent", 0.0) / (self.count * self.watched_s * _TICKS_HZ)


_Of = Callable[[Flight], float]
_ROWS: tuple[tuple[str, _Of, str], ...] = (
    ("command to all ready [s]", lambda f: f.ready_s, ".2f"),
    ("an agent [% of a core]", lambda f: f.share("agent") / f.count, ".2f"),
    ("an agent's CPU a tick [ms]", lambda f: f.tick_ms, ".2f"),
    ("all agents [% of a core]", lambda f: f.share("agent"), ".0f"),
    ("router [%]", lambda f: f.share("router"), ".0f"),
    ("station [%]", lambda f: f.share("station"), ".0f"),
    ("simulator [%]", lambda f: f.share("simulator"), ".0f"),
    ("states that an agent hears [/s]", lambda f: f.heard, ".0f"),
    ("packets on loopback [/s]", lambda f: f.packets, ".0f"),
    ("bytes on loopback [MB/s]", lambda f: f.bytes / 1e6, ".2f"),
    ("ticks late, p99 of the median agent [ms]", lambda f: f.late_p99_ms[0], ".1f"),
    ("p99 of the worst agent [ms]", lambda f: f.late_p99_ms[1], ".1f"),
    ("ticks skipped [%]", lambda f: 100 * f.overruns, ".2f"),
    ("age of a state heard each tick, p99 [ms]", lambda f: f.age_p99_ms, ".0f"),
    (
        "private memory of an agent [MiB]",
        lambda f: f.private_mib.get("agent", 0.0) / f.count,
        ".1f",
    ),
    ("of the router [MiB]", lambda f: f.private_mib.get("router", 0.0), ".0f"),
    ("of the station [MiB]", lambda f: f.private_mib.get("station", 0.0), ".0f"),
)


def main() -> None:
    """Fly all sizes and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--agents", default="6,16,32,64,100")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--lockstep", type=int)
    arguments = parser.parse_args()
    console = Console(markup=False)
    load = os.getloadavg()[0]
    if arguments.lockstep:
        with tempfile.TemporaryDirectory() as name:
            console.print(_in_lockstep(arguments.lockstep, Path(name)))
        return
    flights = []
    for count in map(int, arguments.agents.split(",")):
        with tempfile.TemporaryDirectory() as name:
            flights.append(_flown(count, arguments.seconds, Path(name)))
    console.print(f"load before {load:.1f}, after {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    console.print(_table(flights))


def _table(flights: list[Flight]) -> Table:
    table = Table("agents", *(str(flight.count) for flight in flights), "exponent")
    for title, of, form in _ROWS:
        cells = (format(of(flight), form) for flight in flights)
        table.add_row(title, *cells, _exponent(flights, of))
    table.add_row("outcome", *(flight.outcome for flight in flights))
    return table


def _exponent(flights: list[Flight], of: Callable[[Flight], float]) -> str:
    points = [(flight.count, of(flight)) for flight in flights]
    known = [(n, y) for n, y in points if y > 0 and math.isfinite(y)]
    if len(known) < 2:
        return "-"
    n, y = np.log(known).T
    return f"{np.polyfit(n, y, 1)[0]:.2f}"


def _started(count: int, hold_s: float, folder: Path, *more: str) -> subprocess.Popen[bytes]:
    mission = folder / "scale.yaml"
    mission.write_text(mission_text(count, hold_s))
    command = [str(SWARM_CTL), "run", str(mission), "--headless", "--no-report", *more]
    out = (folder / "out.log").open("wb")
    return subprocess.Popen(command, cwd=folder, stdout=out, stderr=out, start_new_session=True)


def _flown(count: int, seconds: float, folder: Path) -> Flight:
    """Fly, look, land; no process is left."""
    start, flight, pids = time.monotonic(), Flight(count), dict[str, int]()
    process = _started(count, _HOLD_S, folder)
    try:
        run = _wait_for(lambda: next(folder.glob("runs/*/processes.json"), None), process)
        flight.ready_s = time.monotonic() - start
        pids = json.loads(run.read_text())
        _wait_for(lambda: _all_airborne(run.parent) or None, process)
        _watch(flight, pids, seconds)
    except (TimeoutError, OSError) as error:
        flight.outcome = str(error)
    finally:
        _end(process, pids)
    _told(flight, folder)
    return flight


def _wait_for(found: Callable[[], Path | bool | None], process: subprocess.Popen[bytes]) -> Path:
    until = time.monotonic() + _UP_WALL_S
    while time.monotonic() < until and process.poll() is None:
        if result := found():
            return result  # type: ignore[return-value]  # a Path where one is used
        time.sleep(0.02)
    raise TimeoutError("did not get into the air")


def _watch(flight: Flight, pids: dict[str, int], seconds: float) -> None:
    before, traffic, since = _looked(pids), _loopback(), time.monotonic()
    time.sleep(seconds)
    after, later = _looked(pids), _loopback()
    flight.watched_s = time.monotonic() - since
    flight.bytes, flight.packets = (
        (b - a) / flight.watched_s for a, b in zip(traffic, later, strict=True)
    )
    for name, usage in after.items():
        kind = "agent" if name.startswith("agent") else name.split()[0]
        used = usage.cpu_s - before[name].cpu_s
        flight.cpu_s[kind] = flight.cpu_s.get(kind, 0.0) + used
        flight.private_mib[kind] = flight.private_mib.get(kind, 0.0) + usage.private_mib


def _looked(pids: dict[str, int]) -> dict[str, Usage]:
    found = {}
    for name, pid in pids.items():
        found[name] = Usage()
        _look(pid, found[name], time.monotonic())
    return found


def _loopback() -> tuple[int, int]:
    """(bytes, packets) received so far."""
    lines = Path("/proc/net/dev").read_text().splitlines()
    fields = next(line for line in lines if line.strip().startswith("lo:")).partition(":")[2]
    received = fields.split()
    return int(received[0]), int(received[1])


def _end(process: subprocess.Popen[bytes], pids: dict[str, int]) -> None:
    """Land by Ctrl-C; what does not end is killed."""
    for patience_s in (_END_WALL_S, 10.0):
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(patience_s)
            except subprocess.TimeoutExpired:
                continue
    if process.poll() is None:
        process.kill()
        process.wait()
    until = time.monotonic() + 10.0
    while (left := [pid for pid in pids.values() if _lives(pid)]) and time.monotonic() < until:
        time.sleep(0.1)
    for pid in left:
        os.kill(pid, signal.SIGKILL)


def _lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _told(flight: Flight, folder: Path) -> None:
    """What the agents' last words say of the whole flight."""
    paths = folder.glob("runs/*/agents/*.json")
    statuses = [json.loads(path.read_text()) for path in paths]
    if not statuses:
        return
    ticks = [status["tick"] for status in statuses]
    late_ms = [tick["late_p99_ms"] for tick in ticks]
    flight.late_p99_ms = statistics.median(late_ms), max(late_ms)
    flight.overruns = sum(t["overruns"] for t in ticks) / max(1, sum(t["count"] for t in ticks))
    links = [(s, link) for s in statuses for link in s["links"].values()]
    whole_s = sum(status["tick"]["count"] for status in statuses) / _TICKS_HZ / len(statuses)
    flight.heard = sum(link["received"] for _, link in links) / len(statuses) / whole_s
    # a peer heard at every tick, and for half of the flight at least
    often = 0.5 * whole_s * _TICKS_HZ
    ages = [link["age_p99_s"] for _, link in links if link["received"] > often]
    flight.age_p99_ms = 1000 * statistics.median(ages) if ages else math.nan
    flight.outcome = flight.outcome or f"{len(statuses)} of {flight.count} landed"


def _in_lockstep(count: int, folder: Path) -> str:
    """One mission to its end."""
    start = time.monotonic()
    process = _started(count, 5, folder, "--speedup", "max")
    try:
        process.wait()
    finally:
        _end(process, {})
    (run,) = folder.glob("runs/*/summary.json")
    summary = json.loads(run.read_text())
    took_s = time.monotonic() - start
    flown_s = summary["mission_time_s"]
    return (
        f"{count} agents in lockstep: {summary['outcome']}, {flown_s:.0f} s in {took_s:.0f} s"
        f" ({flown_s / took_s:.2f} times real time), nearest {summary['min_true_distance_m']:.2f} m"
    )


if __name__ == "__main__":
    main()
