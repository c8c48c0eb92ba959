"""Hostile frames and samples, as many as asked for, against all that reads what others send:
`python -m tests.bench.bench_hostile [--count 10000000] [--seed 1]`.

Mesh samples come under keys of others, too, mutated from real ones; MAVLink frames reach an agent's
link and a simulated vehicle; missions, plans, CSV files and recordings are mutated. After each
thousand an honest word has to arrive; nothing else than the reader's own error may be raised; the
process may not grow.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.messages import Command, Event, Severity, StationBeacon
from swarm_ctl.core.model.vehicle import StandbyGoal
from swarm_ctl.errors import SwarmError
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.wires import memory_wires
from swarm_ctl.mesh.keys import CHANNELS, STATE
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.payloads import encode
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.plan_file import plan_from_json, plan_to_json
from swarm_ctl.recording import IndexedRecording, recover
from swarm_ctl.recording.mcap_reader import messages
from swarm_ctl.recording.mcap_recorder import McapRecorder
from tests.unit.mavlink import wire
from tests.unit.mission.example import TEXT
from tests.unit.sim.network.test_hub import Clients
from tests.unit.sim.test_hostile import Attacker, check
from tests.unit.station.swarm import hexagon_plan, state_of, status_of

ROUND: Final = 1000
"""Hostile samples between two honest ones."""
PLAN: Final = hexagon_plan()
KIB: Final = 1024
Round = Callable[[random.Random], None]
"""One round of hostile samples, and an honest one; AssertionError where that is lost."""


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Cut, lengthened, with other bytes, or noise."""
    kind = rng.randrange(8)
    if kind == 0:
        return data[: rng.randrange(len(data) + 1)]
    if kind == 1:
        return data + rng.randbytes(rng.randrange(1, 300))
    if kind == 2:
        return rng.randbytes(rng.choice((0, 1, 12, 146, 147, 1400)))
    if kind == 3:
        return data
    made = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        if made:
            made[rng.randrange(len(made))] = rng.randrange(256)
    return bytes(made)


def mesh() -> Round:
    """An agent's node: all channels, keys of agents, stations and none."""
    now = [0.0]
    hub = MemoryHub(lambda: now[0])
    stranger = MemoryTransport(hub)
    peer, node = (Node(MemoryTransport(hub), "s", i) for i in (2, 1))
    node.listen(*CHANNELS, agents=(1, 2, 3))
    samples = [
        encode(state_of(PLAN, 3, 10.0)),
        encode(status_of(PLAN, 3, 10.0)),
        encode(Command("x", "hold", (), 10.0)),
        encode(StationBeacon("evil", 10.0, 1)),
        encode(Event(3, 10.0, Severity.INFO, "word")),
    ]
    names = (2, 3, 7, "evil", "anna.1", "*", "", "x" * 300, "2/../3", "²")
    rates = [channel.key("s", name) for channel in CHANNELS for name in names if name != 2]
    own = state_of(PLAN, 2, 10.0)

    def run(rng: random.Random) -> None:
        for _ in range(ROUND // 50):
            for _ in range(50):
                stranger.publish(rng.choice(rates), mutated(rng, rng.choice(samples)), STATE.qos)
            now[0] += 0.05
            honest = replace(own, time_s=now[0], seq=round(now[0] * 20))
            peer.send(STATE, honest)
            assert honest.seq in [state.seq for state, _ in node.take(STATE) if state.agent == 2]
            for channel in CHANNELS:
                if channel is not STATE:
                    node.take(channel)
        assert node.refused(now[0])

    return run


def link(seed: int) -> Round:
    """An agent's link to its vehicle."""
    ours, theirs = memory_wires()
    vehicle, attacker = wire.Vehicle(theirs, sysid=1), Attacker(seed)
    agent = VehicleLink(ours, "ardupilot", 1)
    pool = [attacker.datagram() for _ in range(3000)]
    now = [0.0]

    def run(rng: random.Random) -> None:
        for _ in range(ROUND // 50):
            for _ in range(50):
                theirs.write(mutated(rng, rng.choice(pool)))
            now[0] += 0.05
            north = round(now[0] * 20) % 1000 / 8
            vehicle.say(
                wire.heartbeat(custom_mode=4, armed=True),
                wire.local_position((north, 0.0, -3.0), boot_ms=round(now[0] * 1000)),
            )
            agent.receive(now[0])
            agent.pursue(StandbyGoal(), now[0])
            local = agent.view().local
            assert local is not None
            assert local.position_ned_m[0] == north
            while ours.read() is not None or theirs.read() is not None:
                pass

    return run


def vehicle(seed: int) -> Round:
    """A simulated vehicle, by a pool of an attacker's datagrams."""
    clients, attacker = Clients(2), Attacker(seed)
    pool = [attacker.datagram() for _ in range(3000)]
    clients.run(0.2)

    def run(rng: random.Random) -> None:
        for k in range(ROUND):
            sender = ("10.0.0.1", rng.randrange(40))
            clients.hub.receive(0, mutated(rng, rng.choice(pool)), sender)
            if k % 10 == 0:
                clients.hub.step()
            if k % 200 == 0:
                clients.datagrams.clear()
                check(clients)

    return run


def files(folder: Path) -> Round:
    """Ten files a round: each costs as much as a hundred frames."""
    mission = folder / "m.yaml"
    mission.write_text(TEXT)
    loaded = load(mission)
    plan = plan_to_json(loaded.plan, loaded.fleet).encode()
    recorder = McapRecorder(folder, 10**18, {})
    for k in range(40):
        recorder.take(state_of(PLAN, 1 + k % 6, float(k)), float(k))
    recorder.close()
    tape = (folder / "recording.mcap").read_bytes()
    offsets = TEXT[TEXT.index("    kind: offsets") : TEXT.index("steps:")]
    csv = TEXT.replace(offsets, "    kind: csv\n    path: row.csv\n")

    path = folder / "hostile"

    def run(rng: random.Random) -> None:
        for _ in range(2):
            path.write_bytes(mutated(rng, TEXT.encode()))
            _refused(lambda: load(path))
            _refused(lambda: plan_from_json(mutated(rng, plan)))
            (folder / "row.csv").write_bytes(mutated(rng, b"north,east\n0,0\n0,2\n0,4\n"))
            mission.write_text(csv)
            _refused(lambda: load(mission))
            path.write_bytes(mutated(rng, tape))
            _refused(lambda: [None for _ in messages(path)])
            _refused(lambda: [_all_of(path), recover(path)])
        path.write_bytes(tape)
        assert sum(message.topic.endswith("/state") for message in messages(path)) == 40
        assert load(folder / "good.yaml").plan == loaded.plan

    (folder / "good.yaml").write_text(TEXT)
    return run


def _all_of(path: Path) -> None:
    with IndexedRecording(path) as recording:
        for k in range(len(recording)):
            recording[k]


def _refused(read: Callable[[], object]) -> None:
    with contextlib.suppress(SwarmError):
        read()


@contextlib.contextmanager
def attacks(seed: int) -> Iterator[dict[str, tuple[Round, int]]]:
    """By name: what runs a round, and the hostile samples in it."""
    with tempfile.TemporaryDirectory() as folder:
        yield {
            "mesh": (mesh(), ROUND),
            "link": (link(seed), ROUND),
            "vehicle": (vehicle(seed), ROUND),
            "files": (files(Path(folder)), 10),
        }


def resident_kib() -> int:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4


def assault(count: int, seed: int) -> dict[str, tuple[int, float, int]]:
    """By name: hostile samples, seconds, growth in KiB after the first tenth."""
    rng, found = random.Random(seed), {}
    shares = {"mesh": 0.5, "link": 0.3, "vehicle": 0.2, "files": 0.0002}
    with attacks(seed) as made:
        for name, (run, size) in made.items():
            rounds = max(2, round(count * shares[name] / size))
            begun, before = time.perf_counter(), 0
            for k in range(rounds):
                if k == rounds // 10:
                    before = resident_kib()
                run(rng)
            seconds = time.perf_counter() - begun
            found[name] = (rounds * size, seconds, resident_kib() - before)
    return found


def main() -> None:
    """Print samples, rate and growth of each reader."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for name, (samples, seconds, growth) in assault(given.count, given.seed).items():
        rate = f"{samples / seconds:,.0f} a second"
        print(f"{name:8} {samples:>10,} samples, {rate}, {growth / KIB:+.1f} MiB")


if __name__ == "__main__":
    main()
